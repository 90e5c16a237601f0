"""A log as a corrected unit would have read it: effects of a file taken out of its samples.

The regressors are those of a replay with the same effects, by the same code: the filter runs, and is listened to. Only
temperature, which is known to the log's end, is smoothed symmetrically, as the tracer does: no rate of it lags. The
filter takes an effect of what is sensed where the reference says that, and of what is read elsewhere; there the
correction is solved for what is sensed, since a reading has its bias and its effects in it. What only the filter can
follow, a drift, stays in; so do the biases, which belong to a power-on.
"""

import heapq
import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from filters.channels import CHANNELS, DPS, G
from filters.effects import plain_names
from filters.effects.records import Included
from filters.effects.runtime import CausalEffects
from filters.kalman.augmentation import Effects
from filters.kalman.runner import Estimator
from filters.kalman.settings import Settings
from filters.motion.reference import COLUMNS, FORCE, RATE
from filters.types import Array
from imutui.jobs import linear_correction, replay, replay_input
from imutui.jobs.replay_input import Feed
from imutui.logbook import effects_file, log_time, power_on, reader, reference_file, schemas
from imutui.logbook.log_stream import MODE
from imutui.logbook.reader import Log
from imutui.logbook.reading import AS_STATED, Reading
from imutui.logbook.session_info import SessionInfo
from imutui.logbook.writer import whole_log
from imutui.plain_text import in_line

APPLIED = "applied_effects.toml"
"""Attachment with the effects that were taken out: not the name under which a replay would take them again."""
_BY_READINGS = ("gravity", "turned")
_SENSED = np.r_[RATE, FORCE]
_DRIFTS = ("random_walk", "gauss_markov")
_ROWS = 2**13  # samples that are encoded at once
_Message: TypeAlias = tuple[int, int, str, bytes]  # Stamp, rank among those of the same stamp, topic, bytes


@dataclass(frozen=True, slots=True)
class Applied:
    """What was made."""

    samples: int  # in the corrected log, with those that are no reading
    set_aside: int  # samples that the file calls no reading (spikes, a channel at its limit), and that now say so
    corrected: tuple[str, ...]  # effects that were taken out, in plain words with their channels
    left: tuple[str, ...]  # effects of the file that no correction takes out, and why
    largest: dict[str, float]  # by channel, the largest correction, deg/s and mg
    damage: str  # what is wrong with the log, if anything: all before it was corrected
    other_unit: str  # said where the effects are of another unit
    assumed: tuple[str, ...]  # of another program's log, in words


def apply(
    path: Path,
    effects: bytes,
    output: Path,
    *,
    reading: Reading = AS_STATED,
    overwrite: bool = False,
    mode: int = MODE,
    progress: Callable[[float], None] = lambda share: None,
) -> Applied:
    """Write a log whose samples are free of the effects of a file.

    `effects`: content of the effects file.
    `reading`: what replaces the statements of the log; its effects do not count.
    `progress`: told the share done, 0 to 1.
    Raises UnreadableLogError if the log cannot be read.
    Raises InputError if the effects cannot be: the message says which, and why.
    Raises FileExistsError if `output` exists and may not be replaced.
    """
    log = reader.read(path, reading=reading)
    reading = replace(reading, effects=effects)
    feed = replay_input.filled(replay_input.at_once(log), replay.session_of(log, reading))
    info, settings = replay.prepare(feed, reading, advice="")
    document = effects_file.parse(effects)
    # of all states in order, those whose mean is a correction
    wanted = np.array([_is_taken_out(effect) for effect in document.effects for _ in effect.states], bool)
    found = _listen(settings, info, feed, wanted, progress)
    found = _of_sensed(found, document.effects, info)
    samples = log.samples
    gyro, accel, valid = samples.gyro.copy(), samples.accel.copy(), samples.valid.copy()
    taken = np.flatnonzero(samples.valid)
    gyro[taken] -= found.correction[:, 3:]
    accel[taken] -= found.correction[:, :3]
    valid[taken] = found.use
    corrected = replace(log, samples=replace(samples, gyro=gyro, accel=accel, valid=valid))
    session = _session(corrected, info, effects, document.source)
    _write(corrected, session, effects, output, overwrite=overwrite, mode=mode)
    progress(1.0)
    return Applied(
        len(samples),
        int(np.count_nonzero(~found.use)),
        tuple(_named(effect) for effect in document.effects if _is_taken_out(effect)),
        tuple(f"{_named(effect)}: {_why_left(effect)}" for effect in document.effects if not _is_taken_out(effect)),
        _largest(found.correction, log.info),
        log.damage,
        effects_file.of_other_unit(effects, info),
        log.assumed,
    )


def _is_taken_out(effect: Included) -> bool:
    return effect.include_as == "P" or (
        bool(effect.states)
        and effect.effect not in _DRIFTS
        and all(math.isinf(s.tau_s) and not s.q for s in effect.states)
    )


def _why_left(effect: Included) -> str:
    if effect.include_as == "N":
        return "a level of noise, which no correction takes out"
    return "a drift, which only a filter follows"


def _named(effect: Included) -> str:
    return plain_names.on_channels(effect.effect, effect.channels)


class _Found(NamedTuple):
    """What effects say of samples."""

    correction: Array  # accelerometer then gyro, body axes, SI, shape (N, 6)
    use: NDArray[np.bool_]  # whether it is a reading, shape (N,)
    # whether the reference says what is sensed, shape (N,); else the correction is of what is read
    sensed: NDArray[np.bool_]


class _Listened:
    """Effects that note what they say of each sample; see `filters.kalman.augmentation.Effects`."""

    def __init__(self, effects: Effects, wanted: NDArray[np.bool_], by_readings: bool) -> None:
        self._effects = effects
        self._by_readings = by_readings
        self.names, self.mean, self.covariance = effects.names, effects.mean, effects.covariance
        self.tau, self.q = effects.tau, effects.q
        self._mean = np.where(wanted, effects.mean, 0.0)
        self.found: list[_Found] = []
        self.count = 0

    def rows(
        self, t: Array, gyro: Array, accel: Array, temperature: Array, known: Array
    ) -> tuple[Array, Array, NDArray[np.bool_]]:
        """What the effects say, noted."""
        if self._by_readings:
            # a unit that was levelled by its own readings would have its bias taken for a tilt
            known = known.copy()
            known[:, _SENSED] = np.nan
        phi, scale, use = self._effects.rows(t, gyro, accel, temperature, known)
        sensed = np.asarray(np.isfinite(known[:, _SENSED]).all(axis=1))
        self.found.append(_Found(phi @ self._mean, use, sensed))
        self.count += t.size
        return phi, scale, use


def _listen(
    settings: Settings,
    info: SessionInfo,
    feed: Feed,
    wanted: NDArray[np.bool_],
    progress: Callable[[float], None],
) -> _Found:
    """Run the filter with the effects over the samples; returns the corrections of each."""
    samples, n = feed.first, len(feed.first)
    if settings.effects is None:
        return _Found(np.zeros((n, 6)), np.ones(n, bool), np.ones(n, bool))
    effects = settings.effects()
    assert isinstance(effects, CausalEffects)
    effects.look_ahead(samples.degc)
    listened = _Listened(effects, wanted, info.reference in _BY_READINGS)
    estimator = Estimator(replace(settings, effects=lambda: listened), np.inf)
    for event in feed.log.events:
        if event.name == "mark":
            estimator.mark(reader.seconds_since(event.stamp_ns, feed.first_ns), event.text)
    for _ in replay.run(estimator, feed, None, progress):
        pass
    if listened.count < n:  # the reference has ended: what is sensed is then what is read
        rest = samples.rows(slice(listened.count, None))
        listened.rows(feed.t(rest), rest.gyro, rest.accel, rest.degc, np.full((len(rest), COLUMNS), np.nan))
    return _Found(*(np.concatenate(column) for column in zip(*listened.found, strict=True)))


def _of_sensed(found: _Found, effects: Sequence[Included], info: SessionInfo) -> _Found:
    """The correction c of what is sensed, where c0 is that of what is read: c = c0 - A c, since sensed = read - c."""
    terms = linear_correction.of_effects(effect for effect in effects if _is_taken_out(effect))
    M = linear_correction.of_terms([0.0] * 6, terms).matrix
    rows = np.flatnonzero(~found.sensed)
    if not rows.size or np.array_equal(M, np.eye(6)):
        return found
    axes, of_read = info.axes(), found.correction[rows]
    dps_g = np.hstack([axes.gyro_to_instrument(of_read[:, 3:]) / DPS, axes.accel_to_instrument(of_read[:, :3]) / G])
    solved = dps_g @ M.T
    correction = found.correction.copy()
    correction[rows] = np.hstack([axes.accel_to_body(solved[:, 3:] * G), axes.gyro_to_body(solved[:, :3] * DPS)])
    return found._replace(correction=correction)


def _largest(correction: Array, info: SessionInfo) -> dict[str, float]:
    accel, gyro = info.outward(correction[:, :3], correction[:, 3:])
    return dict(zip(CHANNELS, np.abs(np.hstack([gyro, accel])).max(axis=0, initial=0.0).tolist(), strict=True))


def _session(log: Log, info: SessionInfo, effects: bytes, source: str) -> SessionInfo:
    """The log's own session; it says what was done to it."""
    own = power_on.ContentId()
    own.add(log.seconds(), log.samples.gyro, log.samples.accel)
    told = f"{in_line(log.path.name)} corrected by effects of {in_line(source)}"
    return replace(info, source=told, corrected_from_sha256=reader.sha256(log.path),
                   applied_effects_sha256=effects_file.digest(effects), log_id=own.text(), effects_sha256="", memory="",
                   continues="", continues_id="", continues_sha256="",
                   previous="", previous_id="", previous_end="", restart="")  # fmt: skip


def _write(log: Log, info: SessionInfo, effects: bytes, output: Path, *, overwrite: bool, mode: int) -> None:
    text = f"# {in_line(log.path.name)}, corrected: {APPLIED}\n"
    first_ns = log.first_ns
    with whole_log(output, info, text, overwrite=overwrite, mode=mode) as writer:
        writer.attach(APPLIED, effects_file.MEDIA_TYPE, effects, first_ns)
        for name in reference_file.ATTACHMENTS:
            if name in log.attachments:
                media = "application/toml" if name.endswith(".toml") else "text/csv"
                writer.attach(name, media, log.attachments[name], first_ns)
        for stamp, _, topic, data in heapq.merge(*_streams(log, info)):
            writer.encoded(topic, data, stamp, stamp)
        seconds = float(log.seconds()[-1])
        summary = {"samples": len(log.samples), "duration_s": seconds, "source": in_line(log.path.name)}
        writer.finish(summary, log_time.now_ns())


def _streams(log: Log, info: SessionInfo) -> Iterator[Iterator[_Message]]:
    """Messages of the corrected log, a stream a topic, each in the order of its stamps."""
    yield _in_order(
        (e.stamp_ns, 0, schemas.EVENTS, schemas.encode_event(e.stamp_ns, e.name, e.text)) for e in log.events
    )
    table, samples = log.table, log.samples
    kind = log.reference or info.reference
    references = schemas.encode_table_references(table.stamp_ns, kind, table.angles_deg, table.rates_dps)
    yield _in_order(_messages(table.stamp_ns, 1, schemas.REFERENCE, references))
    warm = samples.rows(np.isfinite(samples.degc))
    temperatures = schemas.encode_temperatures(warm.stamp_ns, warm.degc)
    yield _in_order(_messages(warm.stamp_ns, 2, schemas.TEMPERATURE, temperatures))
    parts = (samples.rows(slice(first, first + _ROWS)) for first in range(0, len(samples), _ROWS))
    yield itertools.chain.from_iterable(
        _messages(part.stamp_ns, 3, schemas.IMU, schemas.encode_imus(part.stamp_ns, part.gyro, part.accel, part.valid))
        for part in parts
    )
    if log.diagnostics:
        last = int(samples.stamp_ns[-1])
        data = schemas.encode_diagnostics(last, 0, "as it was recorded", log.diagnostics)
        yield iter([(last, 4, schemas.DIAGNOSTICS, data)])


def _messages(stamps: Array, rank: int, topic: str, data: Iterable[bytes]) -> Iterator[_Message]:
    return ((stamp, rank, topic, each) for stamp, each in zip(stamps.tolist(), data, strict=True))


def _in_order(messages: Iterator[_Message]) -> Iterator[_Message]:
    return iter(sorted(messages, key=lambda message: message[0]))
