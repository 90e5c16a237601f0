"""Units beyond the limits of their specification: biases of each power-on, white noise over all logs.

A bias is beyond a limit if it is so by three standard deviations, in any power-on: so much the paper's table allows on
no day. Noise is the unit's, and a mean over its logs is compared.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from filters import specification
from filters.channels import CHANNELS, DPS, MG
from imutui.jobs.campaign import fleet_values
from imutui.jobs.campaign.fleet_values import BiasValue
from imutui.jobs.campaign.rows import Row
from imutui.jobs.campaign.summary_document import LimitField, LimitVerdict, Quantity

SURE = 3.0  # standard deviations beyond a limit at which a value fails it; as many on the inner side are not told
_SQRT_HOUR = 60.0  # √s


class _Worst(NamedTuple):
    """What is compared: how far it is beyond the limit, in sd, and its value."""

    excess: float
    value: float
    sd: float
    row: Row
    converged: bool


def limits(rows: Sequence[Row]) -> list[LimitField]:
    """Units that fail a limit, and those that are too near to tell; a log without a serial number stands for itself.

    `rows`: of one group, with a result.
    """
    units: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        serial = row.get("serial_number") or ""
        units.setdefault((serial, "" if serial else row["log"]), []).append(row)
    found = [one for key in sorted(units) for one in _of_unit(units[key])]
    return sorted(found, key=lambda one: one["verdict"] != "fails")


def _of_unit(rows: Sequence[Row]) -> Iterator[LimitField]:
    spec = specification.of_model(rows[0].get("instrument") or "")
    limits = {"deg/s": spec.gyro_bias_limit / DPS, "mg": spec.accel_bias_limit / MG}
    for told in fleet_values.channels(rows):
        yield from _bias(told.channel, told.unit, limits[told.unit], told.values)
    noises = (spec.gyro_arw / DPS * _SQRT_HOUR, "deg/√h"), (spec.accel_vrw * _SQRT_HOUR, "m/s/√h")
    for number, channel in enumerate(CHANNELS):
        yield from _noise(channel, number, *noises[number // 3], rows)


def _bias(channel: str, unit: str, limit: float, values: Sequence[BiasValue]) -> Iterator[LimitField]:
    each = [_Worst((abs(v.value) - limit) / v.sd, v.value, v.sd, v.row, v.converged) for v in values]
    if not each:
        return
    beyond = [one for one in each if one.excess > SURE]
    # what has settled counts first: an estimate on its way may pass a limit
    worst = max(beyond or each, key=lambda one: (one.converged, one.excess))
    if not beyond:
        worst = max(each, key=lambda one: one.excess)
    if worst.excess <= -SURE:
        return
    fails = bool(beyond) and worst.converged
    above = len({fleet_values.power_on(one.row) for one in beyond})
    of = len({fleet_values.power_on(v.row) for v in values})
    yield _field(worst, channel, unit, limit, "bias", "fails" if fails else "not_told", above, of)


def _noise(channel: str, number: int, limit: float, unit: str, rows: Sequence[Row]) -> Iterator[LimitField]:
    """Mean of the noise over logs, each weighted by how well it is known as a share of itself."""
    known = [(value, sd, row) for row in rows if (told := _noise_of(row, number)) for value, sd in [told]]
    if not known:
        return
    total = sum(sd**-2 for _, sd, _ in known)
    mean = sum(value / sd**2 for value, sd, _ in known) / total
    worst = _Worst(
        (mean - limit) / (limit * total**-0.5), mean, mean * total**-0.5, max(known, key=lambda one: one[0])[2], True
    )
    if worst.excess <= -SURE:
        return
    above = len({fleet_values.power_on(row) for value, sd, row in known if value - limit > SURE * limit * sd})
    of = len({fleet_values.power_on(row) for *_, row in known})
    yield _field(worst, channel, unit, limit, "noise", "fails" if worst.excess > SURE else "not_told", above, of)


def _noise_of(row: Row, number: int) -> tuple[float, float] | None:
    """White noise of a channel, and its standard deviation as a share of it."""
    noise = row.get("noise")
    if not noise or not (relative := noise.get("relative_sd")) or relative <= 0.0:
        return None
    value = (noise["gyro_arw_deg_sqrt_h"] if number < 3 else noise["accel_vrw_mps_sqrt_h"])[number % 3]
    return None if value is None else (value, relative)


def _field(
    worst: _Worst, channel: str, unit: str, limit: float, quantity: Quantity, verdict: LimitVerdict, above: int, of: int
) -> LimitField:
    return {
        "serial_number": worst.row.get("serial_number") or "",
        "channel": channel,
        "quantity": quantity,
        "verdict": verdict,
        "value": worst.value,
        "sd": worst.sd,
        "limit": limit,
        "unit": unit,
        "above": above,
        "of": of,
        "log": worst.row["log"],
        "start_utc": worst.row.get("start_utc"),
        "converged": worst.converged,
    }
