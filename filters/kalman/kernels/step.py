"""The loop over samples, compiled, and the arrays that it works on, by name."""

import math
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numba.core import event

from filters import earth
from filters.compilation import cached_njit
from filters.kalman import layout, settings, strapdown
from filters.kalman.kernels import arithmetic, correction, extra_states, lanes
from filters.kalman.kernels.arithmetic import LANES, PARTS, inlined
from filters.kalman.kernels.correction import correct, innovation
from filters.kalman.kernels.extra_states import carry, drift, effect, gather, note_regressor, take_away
from filters.kalman.kernels.lanes import predict
from filters.kalman.layout import NAV, STRIDE
from filters.kalman.settings import GAP_PERIODS
from filters.types import Array


class Run(NamedTuple):
    """What a run keeps, in the layout of `filters.kalman.layout`."""

    core: Array  # state and totals, shape (CORE,)
    P: Array  # covariance, shape (15 · STRIDE,)
    par: Array  # what does not change but for the noise in force, shape (PAR,)
    # sums, moments: of the present block, shape (SUMS,), and of the errors after convergence, (MOMENTS,)
    sums: Array
    moments: Array
    out: Array  # room for output, shape (rows, OUT)


class Extra(NamedTuple):
    """The p states beyond the 15, p at least 1."""

    # states, across: as `filters.kalman.layout` says, shapes ((EXTRA_OWN + 2 p) · p,) and (2 p · STRIDE,)
    states: Array
    across: Array
    phi: Array  # regressor, shape (N, 6, p)


class Work(NamedTuple):
    """Room for one step: lanes and their errors and deviations, factors, readings at both ends; nothing stays in it."""

    X: Array
    D: Array
    E: Array
    L: Array
    saved: Array
    mean: Array
    nu: Array
    gain: Array
    error: Array
    gyro: Array
    accel: Array
    kept: Array
    C: Array


def make_work() -> Work:
    """Room for one step, zeroed."""
    sizes = (16 * LANES, 16 * LANES, 9 * LANES, 15 * STRIDE, 15 * STRIDE, STRIDE, STRIDE, STRIDE, STRIDE, 6, 6, 36, 9)
    return Work(*map(np.zeros, sizes))


@inlined
def _tally(run, samples, k, at, nu, extra):  # type: ignore[no-untyped-def]
    """Sums for the convergence monitor, moments of the error while `CORE_SPREAD` is set; residuals without effects."""
    core, sums, moments, known = run.core, run.sums, run.moments, samples.known
    for i in range(3):
        sums[layout.SUM_BIAS + i] += core[layout.NAV_BA + i]
        sums[layout.SUM_BIAS + 3 + i] += core[layout.NAV_BG + i]
    sums[layout.SUM_BIASES] += 1.0
    if not math.isnan(known[at + layout.KNOWN_RATE]):
        for i in range(3):
            sums[layout.SUM_RESIDUAL + i] += samples.accel[k, i] - known[at + layout.KNOWN_FORCE + i]
            sums[layout.SUM_RESIDUAL + 3 + i] += samples.gyro[k, i] - known[at + layout.KNOWN_RATE + i]
        if extra is not None:
            for i in range(6):
                sums[layout.SUM_RESIDUAL + i] -= effect(extra, k, i)
        sums[layout.SUM_RESIDUALS] += 1.0
    if core[layout.CORE_SPREAD] != 0.0:
        innovation(core, known, at, nu)
        moments[layout.MOMENT_COUNT] += 1.0
        share = 1.0 / moments[layout.MOMENT_COUNT]
        for i in range(15):
            # error of the state against what is known: the innovation the other way round; biases as they are
            value = -nu[i] if i < 9 else core[layout.NAV_BA + i - 9]
            before = value - moments[layout.MOMENT_MEAN + i]
            moments[layout.MOMENT_MEAN + i] += before * share
            nu[i] = before
        for i in range(15):
            for j in range(15):
                moments[layout.MOMENT_SCATTER + 15 * i + j] += nu[i] * nu[j] * (1.0 - share)


@inlined
def _write(run, t, rows):  # type: ignore[no-untyped-def]
    """Write a row of output, and when the next one is due."""
    core, out = run.core, run.out
    out[rows, layout.OUT_INDEX] = core[layout.CORE_SAMPLES] - 1.0
    out[rows, layout.OUT_T] = t
    for i in range(NAV):
        out[rows, layout.OUT_NAV + i] = core[i]
    out[rows, layout.OUT_NIS] = core[layout.CORE_NIS_LAST]
    out[rows, layout.OUT_DOF] = core[layout.CORE_DOF_LAST]
    for i in range(9):
        out[rows, layout.OUT_NU + i] = core[layout.CORE_NU + i]
    for i in range(15 * STRIDE):
        out[rows, layout.OUT_P + i] = run.P[i]
    core[layout.CORE_NEXT_OUT] += run.par[layout.PAR_EVERY]
    if core[layout.CORE_NEXT_OUT] <= t:
        core[layout.CORE_NEXT_OUT] = t + run.par[layout.PAR_EVERY]


@inlined
def _read(run, samples, k, work):  # type: ignore[no-untyped-def]
    """Readings at both ends of the step to sample k, and the noise in force there."""
    core, par = run.core, run.par
    for i in range(3):
        gyro, accel = samples.gyro[k, i], samples.accel[k, i]
        linear = par[layout.PAR_LINEAR] != 0.0
        work.gyro[i] = core[layout.CORE_GYRO + i] if linear else gyro
        work.accel[i] = core[layout.CORE_ACCEL + i] if linear else accel
        work.gyro[3 + i] = gyro
        work.accel[3 + i] = accel
    if samples.noise_scale.size:
        for i in range(6):
            factor = samples.noise_scale[k, i]
            par[layout.PAR_NOISE + i] = par[layout.PAR_WHITE + i] * factor * factor


@inlined
def _unseen_turn(core, gyro, dt):  # type: ignore[no-untyped-def]
    """Angle that the unit may have turned in a gap, rad: what the two ends say of the rate is off by as much."""
    square = 0.0
    for i in range(3):
        first, last = gyro[i] - core[layout.NAV_BG + i], gyro[3 + i] - core[layout.NAV_BG + i]
        square += max(first * first, last * last)
    return math.sqrt(square) * dt


@inlined
def _step(run, samples, k, at, work, extra):  # type: ignore[no-untyped-def]
    """Predict to sample k and correct there. Returns why it failed (`DONE`: it did not) and the row of P at fault."""
    core, P, par = run.core, run.P, run.par
    dt = samples.t[k] - core[layout.CORE_T]
    held = max(1.0, dt / par[layout.PAR_PERIOD])
    _read(run, samples, k, work)
    if extra is not None:
        drift(extra, dt)
        take_away(extra, k, par, work)
        gather(P, extra, work.kept)
    turned = _unseen_turn(core, work.gyro, dt) if held > GAP_PERIODS else 0.0
    failed = predict(core, P, par, dt, held, turned, work)
    if failed >= 0:
        return layout.INDEFINITE, failed
    if extra is not None:
        carry(P, extra, par, dt, work)
    failed = correct(run, samples, k, at, work, extra)
    if failed >= 0:
        return layout.INDEFINITE, failed
    check = core[0] + core[layout.CORE_NIS_SUM]
    for i in range(NAV):
        check += core[i]
    return (layout.DONE, 0) if math.isfinite(check) else (layout.NOT_FINITE, 0)


def _loop(sources: int) -> Callable[..., Any]:
    """The loop over samples; `sources` stands for the files that it is compiled from.

    Numba keeps what a function closes over beside the function, and compiles anew where it differs.
    """

    def advance(run, samples, first, stop, work, extra):  # type: ignore[no-untyped-def]
        """Feed samples from `first` while t < `stop` and the output has room.

        `run`: changed in place.
        `samples`: a `FilterInput` of N, `known` in one row of KNOWN numbers or N · KNOWN.
        `first`: the first to be used.
        `stop`: s.
        `work`: scratch.
        `extra`: the states of effects.
        Returns index of the first sample not used, rows written to `out`, why it returned (`DONE`, `INDEFINITE`,
          `NOT_FINITE`), and the row of P at fault.
        """
        _ = sources
        core = run.core
        stride = layout.KNOWN if samples.known.size > layout.KNOWN else 0
        rows = 0
        k = first
        while k < samples.t.size and samples.t[k] < stop and rows < run.out.shape[0]:
            t, at = samples.t[k], k * stride
            if core[layout.CORE_SAMPLES] > 0.0:
                why, failed = _step(run, samples, k, at, work, extra)
                if why != layout.DONE:
                    return k, rows, why, failed
            core[layout.CORE_T] = t
            for i in range(3):
                core[layout.CORE_GYRO + i] = samples.gyro[k, i]
                core[layout.CORE_ACCEL + i] = samples.accel[k, i]
            _tally(run, samples, k, at, work.nu, extra)
            if extra is not None:
                note_regressor(extra, k)
            core[layout.CORE_SAMPLES] += 1.0
            if t >= core[layout.CORE_NEXT_OUT] - 1e-9:
                _write(run, t, rows)
                rows += 1
            k += 1
        return k, rows, layout.DONE, 0

    return advance


SOURCES = (earth, layout, settings, strapdown, arithmetic, correction, extra_states, lanes)
"""Modules whose functions and numbers are compiled into `advance`, besides this one."""

advance = cached_njit(_loop(zlib.crc32(b"".join(Path(str(module.__file__)).read_bytes() for module in SOURCES))))


# ----------------------------------------------------------------------------------------------------------- progress
# How far compiling the step has come, in sentences for whoever waits for it.


class _Listener(event.Listener):
    """Counts the parts of the step as numba finishes them."""

    def __init__(self, say: Callable[[str], None], parts: list[Any]) -> None:
        self._say = say
        self._missing = {id(part) for part in parts if not part.signatures}
        self._count = len(parts)

    def on_start(self, event: event.Event) -> None:
        """Nothing: a part is told when it is finished."""

    def on_end(self, event: event.Event) -> None:
        """Tell how many of the parts there are."""
        part = id(event.data["dispatcher"])
        if part in self._missing:
            self._missing.remove(part)
            done = self._count - len(self._missing)
            self._say(f"compiling the filter, once on this machine: {done} of {self._count} parts")


@contextmanager
def told(say: Callable[[str], None] | None, *, effects: bool) -> Iterator[None]:
    """Tell how far compiling has come; nothing is said where the step comes from the disk.

    `say`: takes a sentence, after each part; None where nobody listens.
    `effects`: whether what effects need is compiled as well.
    """
    if say is None:
        yield
        return
    own = [part for part in PARTS if effects or part.py_func.__module__ != extra_states.__name__]
    with event.install_listener("numba:compile", _Listener(say, own)):
        yield
