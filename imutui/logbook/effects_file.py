"""The effects file (TOML): what a trace found and the filter is to take along, as it lies on disk and travels in a log.

Values are in the instrument's axes, sign and units: corrected reading = reading - effect. What is read and written here
is the container; what the effects mean is made of it by `build`.

    version = 1
    source = "trace of a.mcap, b.mcap; held out c.mcap"
    units = ["IMU400CD-200 2901"]              # that the logs are of, if they say so
    correlation = [[1.0, 0.1], [0.1, 1.0]]     # of all states in order

    [[effect]]
    effect = "thermal_lag"
    channels = ["gy"]
    include_as = "A"                           # A constant states, S stochastic states, N noise, P pre-filter

    [effect.parameters]                        # what fixes its shape
    tau_s = 80.0

    [[effect.state]]
    name = "k"
    unit = "deg/s/K"
    mean = 0.02
    sd = 0.001
    tau_s = inf
    q = 0.0                                    # unit/√s
"""

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Required, TypedDict

import numpy as np

from filters.effects import plain_names
from filters.effects.records import Included, State
from filters.errors import InputError
from filters.imu import CHANNELS
from imutui import declared, document_shape, outside_file, plain_text, toml_text
from imutui.declared import Meta
from imutui.logbook.session_info import SessionInfo

if TYPE_CHECKING:
    from filters.kalman.augmentation import Effects, MakeEffects
    from filters.tracing.result import Trace

ATTACHMENT = "effects.toml"  # name under which the effects travel in a log
MEDIA_TYPE = "application/toml"
NONE = b""  # content that stands for no effects
MOST = 256  # effects, and states of all of them


@dataclass(frozen=True, slots=True)
class EffectsDocument:
    """An effects file."""

    source: str  # where it comes from, for people
    effects: tuple[Included, ...]  # in order
    correlation: np.ndarray  # of all states, in order, shape (p, p)
    units: tuple[str, ...] = ()  # model and serial number of those that the effects are of; empty if that is not known

    @property
    def states(self) -> tuple[State, ...]:
        """States of all effects, in the order of the correlation's rows."""
        return tuple(state for effect in self.effects for state in effect.states)

    def covariance(self) -> np.ndarray:
        """Of all states before the first sample, each in its own unit, shape (p, p)."""
        sd = np.array([state.sd for state in self.states])
        return np.asarray(self.correlation * np.outer(sd, sd))


def build(document: EffectsDocument, info: SessionInfo) -> "Effects":
    """Effects of one run, in body axes and SI, from an effects file.

    `info`: axis map, g unit, rate and site of the samples, and what the effects of the file before remembered.
    Raises InputError if an effect is none that there is, or lacks a parameter; the message names it.
    """
    # what is read and written here needs no filter
    from filters.effects.runtime import CausalEffects

    effects = CausalEffects(document.effects, document.correlation, info.axes(), info.site(), 1.0 / info.rate_hz)
    if info.memory:
        effects.restore(info.memory)
    return effects


def maker(content: bytes, info: SessionInfo) -> "MakeEffects | None":
    """What makes the effects of a file for each run; None for no file.

    Made once here, so that what cannot be is said before a run begins.

    `content`: of the file; `NONE` for no effects.
    `info`: of the samples.
    Raises InputError if the content is no effects file, or one of its effects cannot be; the message says what and
      where.
    """
    if content == NONE:
        return None
    document = parse(content)
    make = partial(_build, document, info)
    make()
    return make


def _build(document: EffectsDocument, info: SessionInfo) -> "Effects":
    # looked up when called, so that the seam is one name
    return build(document, info)


def digest(content: bytes) -> str:
    """Hash of a file's content; empty for no effects."""
    return hashlib.sha256(content).hexdigest() if content != NONE else ""


def from_file(path: Path) -> bytes:
    """Content of an effects file, looked at once.

    Raises InputError if it cannot be read, or is none.
    """
    try:
        content = outside_file.read(path, toml_text.LIMIT)
        parse(content)
    except OSError as error:
        raise InputError(f"--effects {path}: {error.strerror or error}. `imutui trace -o` writes such files") from error
    except InputError as error:
        raise InputError(f"--effects {path}: {error}") from error
    return content


def parse(content: bytes) -> EffectsDocument:
    """Read an effects file.

    Raises InputError if it is none; the message names the place.
    """
    try:
        document = toml_text.parse(content)
    except InputError as error:
        raise InputError(f"an effects file is TOML, and this is not: {error}") from error
    if wrong := document_shape.wrong_version(document):
        raise InputError(f"{wrong}. `imutui trace LOG... -o effects.toml` makes it anew")
    return declared.make(document, _File, _document)


def _given(value: Any) -> Any:
    if not value:
        raise InputError("an effect has a name, `effect`, and at least one of the `channels`")
    return value


class _State(TypedDict, total=False):
    name: Required[str]
    unit: Required[str]
    mean: Required[float]
    sd: Required[Annotated[float, Meta(least=0.0)]]
    tau_s: Annotated[float, Meta(above=0.0, most=math.inf)]
    q: Annotated[float, Meta(least=0.0)]


class _Effect(TypedDict, total=False):
    effect: Required[Annotated[str, Meta(make=_given)]]
    channels: Required[Annotated[list[Annotated[str, Meta(allowed=CHANNELS)]], Meta(make=lambda c: tuple(_given(c)))]]
    include_as: Required[Literal["A", "N", "S", "P"]]
    parameters: dict[str, Any]
    state: Annotated[list[Annotated[_State, Meta(make=lambda fields: State(**fields))]], Meta(to="states", make=tuple)]


class _File(TypedDict, total=False):
    version: Required[int]
    source: str
    units: Annotated[list[str], Meta(make=tuple)]
    effect: list[Annotated[_Effect, Meta(make=lambda fields: Included(**fields))]]
    correlation: list[list[float]]


def _document(
    *,
    version: int,
    effect: Sequence[Included] = (),
    source: str = "",
    units: tuple[str, ...] = (),
    correlation: list[list[float]] | None = None,
) -> EffectsDocument:
    p = sum(len(entry.states) for entry in effect)
    if max(len(effect), p) > MOST:
        raise InputError(f"it has {len(effect)} effects with {p} states; the most of each is {MOST}")
    return EffectsDocument(source, tuple(effect), _correlation(correlation, p), units)


def unit_of(info: SessionInfo) -> str:
    """A unit as `units` names it; empty if its serial number is not known."""
    return f"{info.instrument} {info.serial_number}" if info.serial_number else ""


def of_other_unit(content: bytes, info: SessionInfo) -> str:
    """What to say where the effects of a file are of another unit than a log; empty if not, or if one says nothing.

    Raises InputError if the content is no effects file.
    """
    units = parse(content).units if content != NONE else ()
    own = unit_of(info)
    if not units or not own or own in units:
        return ""
    listed = plain_text.in_line(", ".join(units))
    return f"the effects are of another unit ({listed}) than the log ({plain_text.in_line(own)})"


def _correlation(rows: Any, p: int) -> np.ndarray:
    if rows is None or (rows == [] and not p):
        return np.eye(p)
    try:
        matrix = np.array(rows, dtype=np.float64).reshape(-1, p)
    except (ValueError, TypeError, OverflowError) as error:
        raise InputError(f"`correlation` is not a table of {p} by {p} numbers") from error
    if matrix.shape != (p, p):
        raise InputError(f"`correlation` has {len(rows)} rows, not {p}: one a state")
    if not np.allclose(np.diag(matrix), 1.0) or not np.allclose(matrix, matrix.T):
        raise InputError("`correlation` is not symmetric with ones on its diagonal")
    if p and not np.linalg.eigvalsh(matrix)[0] > -1e-9:
        raise InputError("`correlation` is that of no random numbers: it has a negative eigenvalue")
    return matrix


# ---------------------------------------------------------------------------------------------------------- writing


def dumps(trace: "Trace", source: str, units: Sequence[str] = ()) -> str:
    """Text of an effects file; without effects too it is a valid one.

    `trace`: its `included` and their `correlation`.
    `source`: where they come from, in words.
    `units`: whose they are, by `unit_of`.
    """
    head = [f"version = {document_shape.VERSION}", f"source = {toml_text.value(source)}"]
    head += [f"units = {toml_text.value(list(units))}"] if units else []
    head += [f"correlation = {_matrix(trace.correlation)}"]
    return "\n".join([*head, *(line for effect in trace.included for line in _effect_lines(effect))]) + "\n"


def _effect_lines(effect: Included) -> list[str]:
    lines = ["", f"# {plain_names.on_channels(effect.effect, effect.channels)}", "[[effect]]"]
    lines += [f"effect = {toml_text.value(effect.effect)}", f"channels = {toml_text.value(list(effect.channels))}"]
    lines.append(f"include_as = {toml_text.value(effect.include_as)}")
    given = {key: value for key, value in effect.parameters.items() if value is not None}
    if given:
        lines += ["", "[effect.parameters]"]
        lines += [f"{toml_text.key(key)} = {toml_text.value(value)}" for key, value in given.items()]
    for state in effect.states:
        lines += ["", "[[effect.state]]", *_state_lines(state)]
    return lines


def _state_lines(state: State) -> list[str]:
    fields = ("name", "unit", "mean", "sd", "tau_s", "q")
    return [f"{field} = {toml_text.value(getattr(state, field))}" for field in fields]


def _matrix(values: Any) -> str:
    rows = np.atleast_2d(np.asarray(values, np.float64)) if np.size(values) else np.empty((0, 0))
    if len(rows) < 2:
        return toml_text.value(rows.tolist())
    return "[\n" + "".join(f"    {toml_text.value(row)},\n" for row in rows.tolist()) + "]"
