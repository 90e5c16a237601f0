"""The filter of a take: samples wait while its step is being compiled, then all go through in order."""

import threading
import time
from collections.abc import Iterator

import numpy as np

from filters.kalman import layout, runner
from filters.kalman.augmentation import MakeEffects
from filters.kalman.runner import Estimator
from filters.kalman.spkf import DivergenceError
from filters.motion.profile import Profile
from filters.motion.reference import Trajectory
from imutui.logbook import estimates, reader
from imutui.logbook.session_info import SessionInfo

ESTIMATE_PERIOD_S = 0.1
_ready, _ready_with_effects = threading.Event(), threading.Event()
_started, _started_with_effects = threading.Event(), threading.Event()


def prepare(*, effects: bool = False) -> None:
    """Begin to load or compile the filter's step; the first time on a machine it takes some seconds.

    Parameters
    ----------
    effects : bool
        The step with states of effects, which is one of its own.
    """
    started = _started_with_effects if effects else _started
    if not started.is_set():
        started.set()
        threading.Thread(target=_prepare, args=(effects,), name="compiler", daemon=True).start()


def _prepare(effects: bool) -> None:
    try:
        runner.warm_up(effects=effects)
    finally:
        # if that failed, the first step will say why
        (_ready_with_effects if effects else _ready).set()


class LiveFilter:
    """The estimator of one take, and what keeps it from stopping a recording.

    Parameters
    ----------
    info : SessionInfo
        Settings.
    motion : Profile, Trajectory or None
        What the reference needs.
    effects : callable or None
        Makes the effects that join the filter.
    """

    def __init__(
        self, info: SessionInfo, motion: Profile | Trajectory | None = None, effects: MakeEffects | None = None
    ) -> None:
        self.info = info
        self.estimator = Estimator(info.settings(motion, effects=effects), every=ESTIMATE_PERIOD_S)
        self.failure: str | None = None
        self.seconds = 0.0
        self.waiting = 0
        self._first_ns: int | None = None
        self._waiting: list[tuple[float, np.ndarray, np.ndarray, float]] = []
        self._marks: list[tuple[int, str]] = []

    @property
    def _step_ready(self) -> threading.Event:
        return _ready_with_effects if self.estimator.extra_states else _ready

    def mark(self, stamp_ns: int, text: str) -> None:
        """Take an operator's mark."""
        self._marks.append((stamp_ns, text))
        if self._first_ns is not None:
            self._pass_marks()

    def _pass_marks(self) -> None:
        for stamp_ns, text in self._marks:
            self.estimator.mark(reader.seconds_since(stamp_ns, self._first_ns or 0), text)
        self._marks.clear()

    def sample(
        self, stamp_ns: int, gyro: np.ndarray, accel: np.ndarray, degc: float = np.nan
    ) -> Iterator[tuple[int, bytes]]:
        """Take a sample and its temperature; yield stamps and messages of estimates that are due."""
        if self.failure is not None:
            return
        if self._first_ns is None:
            self._first_ns = stamp_ns
            self._pass_marks()
            # not before: while the instrument is being asked who it is, nothing may delay the answers
            prepare(effects=self.estimator.extra_states > 0)
        self._waiting.append((reader.seconds_since(stamp_ns, self._first_ns), gyro, accel, degc))
        self.waiting = len(self._waiting)
        if self._step_ready.is_set():
            yield from self._use(last=False)

    def finish(self) -> Iterator[tuple[int, bytes]]:
        """Use all that still waits; yield as `sample`."""
        if self.failure is None and self._first_ns is not None:
            self._step_ready.wait()
            yield from self._use(last=True)

    def _use(self, *, last: bool) -> Iterator[tuple[int, bytes]]:
        waiting, self._waiting, self.waiting = self._waiting, [], 0
        t = np.array([sample[0] for sample in waiting])
        gyro = np.array([sample[1] for sample in waiting]).reshape(-1, 3)
        accel = np.array([sample[2] for sample in waiting]).reshape(-1, 3)
        temperature = np.array([sample[3] for sample in waiting], float)
        started = time.perf_counter()
        try:
            for rows in runner.rows(self.estimator, t, gyro, accel, temperature, last=last):
                yield from self._messages(rows)
        except (DivergenceError, ValueError) as error:
            self.failure = f"the filter stopped, recording goes on: {error}"
        self.seconds += time.perf_counter() - started

    def _messages(self, rows: np.ndarray) -> Iterator[tuple[int, bytes]]:
        assert self._first_ns is not None
        stamps = self._first_ns + np.round(rows[:, layout.OUT_T] * 1e9).astype(np.int64)
        verdict = estimates.Verdict.of(self.estimator, self.info)
        yield from zip(stamps.tolist(), estimates.encode(rows, stamps, verdict, self.info), strict=True)
