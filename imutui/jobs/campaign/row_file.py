"""Rows of a campaign in a file, as far as a summary needs them: read within bounds, and looked at."""

from pathlib import Path
from typing import Any, NotRequired, TypedDict, cast

from filters.errors import InputError
from imutui import outside_file
from imutui.jobs import document_shape
from imutui.jobs.campaign.rows import ConvergedField, FindingField, NoiseField, Row, TemperatureField
from imutui.logbook.reader import UnreadableLogError

FILE = "results.json"
LIMIT = 2**30
"""Longest file of rows, bytes: some 300 000 rows."""
_HOW = "`imutui campaign LOG... -o RESULTS` makes it"


class _Biases(TypedDict):
    """What is read of `final` and `sd`."""

    accel_bias_mg: list[float | None]
    gyro_bias_dps: list[float | None]


class _Needed(TypedDict):
    """What is read of a row: fewer fields than a row has, so that rows of another version serve too."""

    log: str
    final: _Biases | None
    error: NotRequired[str | None]
    sd: NotRequired[_Biases | None]
    kind: NotRequired[str]
    instrument: NotRequired[str]
    serial_number: NotRequired[str]
    start_utc: NotRequired[str | None]
    power_on: NotRequired[str | None]
    temperature_degc: NotRequired[TemperatureField | None]
    converged_s: NotRequired[ConvergedField | None]
    noise: NotRequired[NoiseField | None]
    findings: NotRequired[list[FindingField] | None]
    trace_error: NotRequired[str | None]
    settings_sha256: NotRequired[str]
    reference: NotRequired[str | None]


def path_of(results: Path) -> Path:
    """The file of rows of a campaign's folder; a file is itself."""
    return results / FILE if results.is_dir() else results


def read(results: Path) -> list[Row]:
    """Rows of a campaign; fields that a summary does not read may lack.

    `results`: the folder that a campaign wrote, or its `results.json`.
    Raises UnreadableLogError if there is none, or it has no rows, or what stands there is of another shape; the message
      says where.
    """
    path = path_of(results)
    try:
        content = outside_file.read_json(path, LIMIT)
    except OSError as error:
        raise UnreadableLogError(f"{path}: {error.strerror or error}. {_HOW}") from error
    except InputError as error:
        raise UnreadableLogError(f"{path} is no JSON of a campaign: {error}. {_HOW}") from error
    rows = content.get("rows") if isinstance(content, dict) else None
    if not isinstance(rows, list):
        raise UnreadableLogError(f"{path} is no result of a campaign: it has no list `rows`. {_HOW}")
    if not rows:
        raise UnreadableLogError(f"{path} has no row in it: the campaign found no log. {_HOW}")
    for number, row in enumerate(rows):
        if told := _problem(row, f"rows[{number}]"):
            raise UnreadableLogError(f"{path} is no result of a campaign: {told}. {_HOW}")
    return cast("list[Row]", rows)


def _problem(row: object, where: str) -> str:
    if told := document_shape.problem(row, _Needed, where):
        return told
    return _uneven(cast("dict[str, Any]", row), where)


def _uneven(row: dict[str, Any], where: str) -> str:
    """Which list has not a number for each axis."""
    if row["final"] is not None and row.get("sd") is None:
        return f"`{where}.sd` is missing"
    biases = ("accel_bias_mg", "gyro_bias_dps")
    vectors = [(f"{name}.{key}", row[name][key]) for name in ("final", "sd") if row.get(name) for key in biases]
    noise, since = row.get("noise") or {}, row.get("converged_s") or {}
    vectors += [(f"noise.{key}", noise[key]) for key in ("gyro_arw_deg_sqrt_h", "accel_vrw_mps_sqrt_h") if noise]
    vectors += [(f"converged_s.{key}", since[key]) for key in ("accel_bias", "gyro_bias") if key in since]
    return next((f"`{where}.{name}` has not three numbers" for name, own in vectors if len(own) != 3), "")
