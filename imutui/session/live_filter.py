"""The filter of a run: samples wait while its code is loaded or compiled, then all go through in order.

Compiler, compiled step and statistics take seconds to load, and much longer to compile the first time on a machine.
They are loaded in a thread once the first packet is on the disk; nothing here imports them before.
"""

import gc
import importlib
import threading
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from filters.errors import InputError
from filters.kalman import layout
from filters.kalman.augmentation import MakeEffects
from filters.kalman.filter_input import Readings
from filters.motion.profile import Profile
from filters.motion.reference import Trajectory
from imutui import compile_cache, defects
from imutui.estimate_history import EstimateHistory, HistorySnapshot
from imutui.logbook import reader
from imutui.logbook.samples import Samples
from imutui.logbook.session_info import SessionInfo
from imutui.session.plan import HistoryWish

if TYPE_CHECKING:
    from filters.kalman.runner import Estimator


BIASES = 6
PIECE_ROWS = 100  # rows in a piece; about a millisecond of writing


class RunHistory:
    """Estimates and temperature of one run, for viewers; one that attaches late gets all of it, in bounded memory.

    It is sent in pieces: a long reply would keep the reader of the port from its stamps.
    """

    def __init__(self) -> None:
        self.estimates = EstimateHistory(BIASES)  # gyro, deg/s, then accelerometers, mg; instrument axes
        self.temperature = EstimateHistory(1)  # degC

    def add_temperature(self, t: np.ndarray, degc: np.ndarray) -> None:
        """Add the temperatures of samples, `t` s since the first one, shapes (N,)."""
        self.temperature.add_all(t, degc[:, None], np.zeros((t.size, 1)))

    def piece(self, run: int, wish: HistoryWish) -> HistorySnapshot:
        """Return what a viewer that has `wish` lacks of this run, as far as one reply has room for it."""
        known = wish if wish.run == run else HistoryWish()
        estimates = self.estimates.rows(known.estimates_s, PIECE_ROWS)
        temperature = self.temperature.rows(known.temperature_s, PIECE_ROWS)
        full = PIECE_ROWS in (len(estimates["t"]), len(temperature["t"]))
        return {"run": run, "estimates": estimates, "temperature": temperature, "complete": not full}


ESTIMATE_PERIOD_S = 0.1


class Preparation:
    """Loads the filter's step, or compiles it the first time on a machine; in a thread, once a process.

    With `effects` the step for their states is prepared beside the plain one: effects need not add any state.
    """

    def __init__(self, *, effects: bool) -> None:
        self.ready = threading.Event()  # the step can be used, or raises the reason why it cannot
        self._effects = effects
        self._begun_at: float | None = None

    def begin(self) -> None:
        """Begin, once."""
        if self._begun_at is None:
            self._begun_at = time.monotonic()
            threading.Thread(target=self._run, name="compiler", daemon=True).start()

    def seconds(self) -> float:
        """Return the time since it began; 0 before."""
        return 0.0 if self._begun_at is None else time.monotonic() - self._begun_at

    def _run(self) -> None:
        try:
            from filters.kalman import runner

            load()
            for effects in (False, True)[: 1 + self._effects]:
                runner.warm_up(effects=effects)
        finally:
            # if that failed, the first step raises the reason
            self.ready.set()
            # a search for garbage through all that was loaded would make the reader late
            gc.freeze()
            compile_cache.release()


PLAIN, WITH_EFFECTS = Preparation(effects=False), Preparation(effects=True)


def load() -> None:
    """Load the filter's modules here and now, without compiling anything."""
    for module in ("filters.kalman.engines", "imutui.logbook.estimate_rows"):
        importlib.import_module(module)
    from filters.kalman import series_evidence

    series_evidence.prepare()


_NOTHING = Readings(np.empty(0), np.empty((0, 3)), np.empty((0, 3)), np.empty(0))


class LiveFilter:
    """Runs the estimator of one run of samples; a failure of it does not stop a recording.

    `motion` is what the reference needs, `effects` makes the effects that join the filter, `history` takes the biases.
    Raises InputError if the settings cannot be.
    """

    def __init__(
        self,
        info: SessionInfo,
        motion: Profile | Trajectory | None = None,
        effects: MakeEffects | None = None,
        history: EstimateHistory | None = None,
    ) -> None:
        self.info = info
        self.history = EstimateHistory(BIASES) if history is None else history
        self.estimator: Estimator | None = None  # until the first samples are used
        self.failure: str | None = None  # why the filter stopped
        self.defect: Exception | None = None  # the exception that stopped it, if it is a fault of the filter's code
        self.seconds = 0.0  # that it took so far
        self.waiting = 0  # samples that wait for it
        self.preparation = PLAIN if effects is None else WITH_EFFECTS
        self._settings = info.settings(motion, effects=effects)
        self._first_ns: int | None = None
        self._said = 0  # changes of causes that were reported
        self._waiting: list[Readings] = []
        self._marks: list[tuple[int, str]] = []

    def mark(self, stamp_ns: int, text: str) -> None:
        """Take a mark of the operator; it reaches the estimator before the samples that come after it."""
        self._marks.append((stamp_ns, text))

    def samples(self, samples: Samples) -> Iterator[tuple[int, bytes]]:
        """Take samples, all of them valid; yield stamps and messages of estimates."""
        if self.failure is not None or not len(samples):
            return
        if self._first_ns is None:
            self._first_ns = int(samples.stamp_ns[0])
            # not before: nothing may delay the answers of an instrument that is being identified
            self.preparation.begin()
        t = reader.seconds_since(samples.stamp_ns, self._first_ns)
        self._waiting.append(Readings(t, samples.gyro, samples.accel, samples.degc))
        self.waiting += len(samples)
        if self.preparation.ready.is_set():
            yield from self._use(last=False)

    def memory(self) -> str:
        """Return what the effects remember of temperature, for the file that follows; "" if nothing."""
        effects = None if self.estimator is None or self.failure is not None else self.estimator.effects
        if effects is None:
            return ""
        from filters.effects.runtime import CausalEffects

        return effects.memory() if isinstance(effects, CausalEffects) else ""

    def news(self) -> Iterator[tuple[str, str]]:
        """Yield names and texts of events of new and withdrawn causes in the residual."""
        watch = None if self.estimator is None else self.estimator.watch
        if watch is not None and len(watch.changes) > self._said:
            from imutui.logbook import departures

            new, self._said = watch.changes[self._said :], len(watch.changes)
            for name, one in new:
                yield name, departures.event_text(departures.cause_field(one, self.info))

    def leave_out_unless_ready(self, patience_s: float) -> None:
        """Give up the estimates if the step is not ready by then; a replay will make them."""
        if self._first_ns is not None and not self.preparation.ready.wait(patience_s):
            self.failure = self.failure or (
                "the acquisition was ended before the filter was compiled, as it is the first time on a machine:"
                " the recording is complete, and `imutui replay` makes its estimates"
            )

    def finish(self) -> Iterator[tuple[int, bytes]]:
        """Filter all samples that still wait; yield as `samples` does."""
        if self.failure is None and self._first_ns is not None:
            self.preparation.ready.wait()
            yield from self._use(last=True)

    def _use(self, *, last: bool) -> Iterator[tuple[int, bytes]]:
        from filters.kalman import runner

        waiting, self._waiting, self.waiting = self._waiting, [], 0
        fed = Readings.joined([_NOTHING, *waiting])
        started = time.perf_counter()
        try:
            estimator = self._begun()
            for rows in runner.rows(estimator, fed.t, fed.gyro, fed.accel, fed.temperature, last=last):
                yield from self._messages(estimator, rows)
        except InputError as error:
            self.failure = f"the filter stopped, recording goes on: {error}"
        except Exception as error:  # noqa: BLE001 - the recording raises it once the file has the packets
            self.failure, self.defect = f"the filter stopped: {defects.told(error)}", error
        self.seconds += time.perf_counter() - started

    def _begun(self) -> "Estimator":
        """Return the estimator, made the first time, with all marks so far."""
        from filters.kalman.runner import Estimator

        assert self._first_ns is not None
        if self.estimator is None:
            self.estimator = Estimator(self._settings, every=ESTIMATE_PERIOD_S)
        for stamp_ns, text in self._marks:
            self.estimator.mark(reader.seconds_since(stamp_ns, self._first_ns), text)
        self._marks.clear()
        return self.estimator

    def _messages(self, estimator: "Estimator", rows: np.ndarray) -> Iterator[tuple[int, bytes]]:
        from imutui.logbook.estimate_rows import BiasVerdicts, EstimateRows

        assert self._first_ns is not None
        stamps = self._first_ns + np.round(rows[:, layout.OUT_T] * 1e9).astype(np.int64)
        made = EstimateRows(rows, BiasVerdicts.of(estimator, self.info), self.info)
        made.add_to(self.history)
        yield from zip(stamps.tolist(), made.encode(stamps), strict=True)
