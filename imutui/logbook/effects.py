"""The effects file (TOML): what a trace found and the filter is to take along, as it lies on disk and travels in a log.

Values are in the instrument's axes, sign and units. What is read here is the container; what the effects mean is made
of it by `build`.
"""

import hashlib
import math
import tomllib
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from filters.effects.causal import CausalEffects
from filters.effects.record import Included, State
from filters.inclusion import Effects, MakeEffects
from imutui.logbook.session import SessionInfo

ATTACHMENT = "effects.toml"
"""Name under which the effects travel in a log."""
MEDIA_TYPE = "application/toml"
NONE = b""
"""Content that stands for no effects."""
VERSION = 1
_KINDS = ("A", "N", "S", "P")
_CHANNELS = ("gx", "gy", "gz", "ax", "ay", "az")
_TOP = ("version", "source", "effect", "correlation")
_EFFECT = ("effect", "channels", "include_as", "parameters", "state")
_STATE = ("name", "unit", "mean", "sd", "tau_s", "q")


@dataclass(frozen=True, slots=True)
class EffectsDocument:
    """An effects file.

    Attributes
    ----------
    source : str
        Where it comes from, for people.
    effects : tuple of Included
        In order.
    correlation : np.ndarray
        Of all states, in order, shape (p, p).
    """

    source: str
    effects: tuple[Included, ...]
    correlation: np.ndarray

    @property
    def states(self) -> tuple[State, ...]:
        """Of all effects, in order."""
        return tuple(state for effect in self.effects for state in effect.states)

    def covariance(self) -> np.ndarray:
        """Of all states before the first sample, each in its own unit, shape (p, p)."""
        sd = np.array([state.sd for state in self.states])
        return np.asarray(self.correlation * np.outer(sd, sd))


def build(document: EffectsDocument, info: SessionInfo) -> Effects:
    """Effects of one run, in body axes and SI, from an effects file.

    Parameters
    ----------
    document : EffectsDocument
        The file.
    info : SessionInfo
        Axis map, g unit, rate and site of the samples.

    Raises
    ------
    ValueError
        If an effect is none that there is, or lacks a parameter; the message names it.
    """
    return CausalEffects(document.effects, document.correlation, info.axes(), info.site(), 1.0 / info.rate_hz)


def maker(content: bytes, info: SessionInfo) -> MakeEffects | None:
    """What makes the effects of a file for each run; None for no file.

    Made once here, so that what cannot be is said before a run begins.

    Parameters
    ----------
    content : bytes
        Of the file; `NONE` for no effects.
    info : SessionInfo
        Of the samples.

    Raises
    ------
    ValueError
        If the content is no effects file, or one of its effects cannot be; the message says what and where.
    """
    if content == NONE:
        return None
    document = parse(content)
    make = partial(_build, document, info)
    make()
    return make


def _build(document: EffectsDocument, info: SessionInfo) -> Effects:
    # looked up when called, so that the seam is one name
    return build(document, info)


def digest(content: bytes) -> str:
    """Hash of a file's content; empty for no effects."""
    return hashlib.sha256(content).hexdigest() if content != NONE else ""


def from_file(path: Path) -> bytes:
    """Content of an effects file, looked at once.

    Raises
    ------
    ValueError
        If it cannot be read, or is none.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise ValueError(f"--effects {path}: {error.strerror or error}. `imutui trace -o` writes such files") from error
    try:
        parse(content)
    except ValueError as error:
        raise ValueError(f"--effects {path}: {error}") from error
    return content


def parse(content: bytes) -> EffectsDocument:
    """Read an effects file.

    Raises
    ------
    ValueError
        If it is none; the message names the place.
    """
    try:
        document = tomllib.loads(content.decode("utf-8-sig"))
    except (UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise ValueError(f"{ATTACHMENT} is not TOML: {error}") from error
    version = document.get("version")
    if version != VERSION:
        said = "has no `version`" if version is None else f"has `version` {version}"
        raise ValueError(f"{ATTACHMENT} {said}; this imutui reads version {VERSION}")
    _only(document, _TOP, "the file")
    tables = document.get("effect", [])
    if not isinstance(tables, list):
        raise ValueError("`effect` is one table; effects are a list, [[effect]]")
    effects = tuple(_effect(table, f"effect {k + 1}") for k, table in enumerate(tables))
    p = sum(len(entry.states) for entry in effects)
    return EffectsDocument(str(document.get("source", "")), effects, _correlation(document.get("correlation"), p))


def _effect(table: Any, where: str) -> Included:
    if not isinstance(table, dict):
        raise ValueError(f"{where} is not a table")
    _only(table, _EFFECT, where)
    name, channels, kind = table.get("effect"), table.get("channels"), table.get("include_as")
    if not isinstance(name, str) or not name:
        raise ValueError(f"{where} has no name: `effect` is {name!r}")
    where = f'{where} ("{name}")'
    if not isinstance(channels, list) or not channels or not all(c in _CHANNELS for c in channels):
        raise ValueError(f"{where}: `channels` is {channels!r}, not a list of {', '.join(_CHANNELS)}")
    if kind not in _KINDS:
        raise ValueError(f"{where}: `include_as` is {kind!r}, not one of {', '.join(_KINDS)}")
    parameters, states = table.get("parameters", {}), table.get("state", [])
    if not isinstance(parameters, dict):
        raise ValueError(f"{where}: `parameters` is not a table")
    if not isinstance(states, list):
        raise ValueError(f"{where}: `state` is one table; states are a list, [[effect.state]]")
    entries = tuple(_state(state, f"{where}, state {k + 1}") for k, state in enumerate(states))
    return Included(name, tuple(channels), kind, parameters, entries)


def _state(table: Any, where: str) -> State:
    if not isinstance(table, dict):
        raise ValueError(f"{where} is not a table")
    _only(table, _STATE, where)
    for key in ("name", "unit"):
        if not isinstance(table.get(key), str):
            raise ValueError(f"{where}: `{key}` is {table.get(key)!r}, not a text")
    defaults = {"tau_s": math.inf, "q": 0.0}
    mean, sd, tau, q = (_number(table.get(key, defaults.get(key)), key, where) for key in ("mean", "sd", "tau_s", "q"))
    if not math.isfinite(mean):
        raise ValueError(f"{where}: `mean` is {mean}")
    for key, value in (("sd", sd), ("q", q)):
        if not 0.0 <= value < math.inf:
            raise ValueError(f"{where}: `{key}` is {value}, not zero or a positive number")
    if not tau > 0.0:
        raise ValueError(f"{where}: `tau_s` is {tau}, not positive")
    return State(table["name"], table["unit"], mean, sd, tau, q)


def _number(value: Any, key: str, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"{where}: `{key}` is {value!r}, not a number")
    return float(value)


def _correlation(rows: Any, p: int) -> np.ndarray:
    if rows is None:
        return np.eye(p)
    try:
        matrix = np.array(rows, dtype=np.float64).reshape(-1, p)
    except (ValueError, TypeError) as error:
        raise ValueError(f"`correlation` is not a table of {p} by {p} numbers") from error
    if matrix.shape != (p, p):
        raise ValueError(f"`correlation` has {len(rows)} rows, not {p}: one a state")
    if not np.allclose(np.diag(matrix), 1.0) or not np.allclose(matrix, matrix.T):
        raise ValueError("`correlation` is not symmetric with ones on its diagonal")
    if p and not np.linalg.eigvalsh(matrix)[0] > -1e-9:
        raise ValueError("`correlation` is that of no random numbers: it has a negative eigenvalue")
    return matrix


def _only(table: dict[str, Any], keys: tuple[str, ...], where: str) -> None:
    unknown = sorted(set(table) - set(keys))
    if unknown:
        raise ValueError(f"{where} has `{unknown[0]}`; it may have: {', '.join(keys)}")
