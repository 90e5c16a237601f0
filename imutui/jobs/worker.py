"""A job in a process of its own, so that a screen neither waits for it nor falls with it.

    worker = Worker(tasks.replay_log, path)
    worker.start()
    worker.poll()       # now and then: [Progress(share, text), …]
    worker.state        # "running", then "done" (worker.result), "failed" (worker.failure) or "cancelled"
    worker.cancel()     # at any time

The process is `python -m imutui.jobs.worker`; the job goes to it by its stdin, what comes of it comes by its stdout. It
ends when its stdin does, which is when whoever started it ends, however that happens.
"""

import contextlib
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import IO, Any, NamedTuple

from filters.errors import InputError
from imutui import defects

WAITING = "waiting"
RUNNING = "running"
DONE = "done"
FAILED = "failed"
CANCELLED = "cancelled"
_GRACE_S = 5.0
_EVERY_S = 0.1
_DEFECT = "Defect"


class Progress(NamedTuple):
    """How far a job is: the share done, 0 to 1, and what is being done."""

    share: float
    text: str


class Failure(NamedTuple):
    """Why a job gave no result."""

    kind: str  # name of the error's class; "Defect" for one that no input can cause
    text: str  # what it says, never empty


class Worker:
    """One job, once.

    `function`: at a module's top level. It is called with the arguments and, last, a callable that takes share and
      text.
    `*args`: what can be pickled.
    """

    def __init__(self, function: Callable[..., Any], *args: Any) -> None:
        self._job = (function, args)
        self._process: subprocess.Popen[bytes] | None = None
        self._progress: deque[Progress] = deque(maxlen=256)
        self._ended = threading.Event()
        self._cancelled = False
        self.result: Any = None  # what the job returned, when it is done
        self._failure: Failure | None = None

    def start(self) -> None:
        """Start the process and hand it the job; returns at once."""
        assert self._process is None, "a worker works once"
        environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
        command = [sys.executable, "-P", "-m", __name__]
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, env=environment
        )
        threading.Thread(target=self._follow, name="worker's reader", daemon=True).start()

    @property
    def state(self) -> str:
        """Where it stands: "waiting" to be started, "running", "done", "failed" or "cancelled"."""
        if self._process is None:
            return WAITING
        if not self._ended.is_set():
            return RUNNING
        if self._cancelled and self._failure is not None:
            return CANCELLED
        return DONE if self._failure is None else FAILED

    @property
    def failure(self) -> Failure | None:
        """Why there is no result, when it failed or was cancelled."""
        return self._failure if self._ended.is_set() else None

    def poll(self) -> list[Progress]:
        """What the job has told since the last look; never waits."""
        return [self._progress.popleft() for _ in range(len(self._progress))]

    def cancel(self) -> None:
        """Ask the job to clean up and end, and see to it; returns at once. The state follows when it has ended."""
        if self._process is None or self._ended.is_set() or self._cancelled:
            return
        self._cancelled = True
        self._process.terminate()
        threading.Thread(target=self._insist, name="worker's end", daemon=True).start()

    def wait(self, timeout: float | None = None) -> bool:
        """Wait for the end; whether it has come."""
        return self._ended.wait(timeout)

    def _insist(self) -> None:
        assert self._process is not None
        if not self._ended.wait(_GRACE_S):
            self._process.kill()

    def _follow(self) -> None:
        """In a thread of its own: hand the job over, take what comes, and the exit status, so that no zombie stays."""
        assert self._process is not None
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        outcome: tuple[str, Any] | None = None
        try:
            with contextlib.suppress(BrokenPipeError):
                pickle.dump((sys.path, pickle.dumps(self._job)), self._process.stdin)
                self._process.stdin.flush()
            while outcome is None:
                kind, value = pickle.load(self._process.stdout)
                if kind == "progress":
                    self._progress.append(Progress(*value))
                else:
                    outcome = kind, value
        except EOFError:
            pass  # it ended without a word; the exit code says how
        except Exception as error:  # noqa: BLE001 - what cannot be pickled either way is the job's failure, in words
            outcome = "failed", Failure(_DEFECT, defects.told(error))
            self._process.kill()
        self._process.stdin.close()
        code = self._process.wait()
        self._process.stdout.close()
        if outcome is None:
            self._failure = self._without_a_word(code)
        elif outcome[0] == "failed":
            self._failure = Failure(*outcome[1])
        else:
            self.result = outcome[1]
        self._ended.set()

    def _without_a_word(self, code: int) -> Failure:
        if self._cancelled:
            return Failure("Cancelled", "cancelled")
        if code == -signal.SIGKILL:
            return Failure("Killed", "its process was killed, as happens when memory runs out. Take a part of the log.")
        how = f"by signal {-code}" if code < 0 else f"with exit code {code}"
        return Failure("Crashed", f"its process ended {how} and said nothing. Recordings are not affected.")


# -- in the process ----------------------------------------------------------------------------------------------------


class _Cancelled(BaseException):
    """The job is to clean up and end."""


def main() -> int:
    """Do the job that comes by stdin; returns the exit code."""
    out = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    # what a library prints must not get among the answers
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl+C is for whoever started this
    signal.signal(signal.SIGTERM, _on_term)
    jobs = sys.stdin.buffer
    try:
        path, job = pickle.load(jobs)
        sys.path[:] = path
        threading.Thread(target=_end_with_parent, args=(jobs,), daemon=True).start()
        outcome = _done(job, out)
    except _Cancelled:
        outcome = ("failed", ("Cancelled", "cancelled"))
    with contextlib.suppress(BrokenPipeError, _Cancelled):
        pickle.dump(outcome, out)
        out.flush()
    # the threads of libraries must not keep a process alive whose work is done
    os._exit(0)


def _done(job: bytes, out: IO[bytes]) -> tuple[str, Any]:
    try:
        function, args = pickle.loads(job)
        result = function(*args, _Teller(out))
        pickle.dumps(result)  # or else half an answer would be on its way
    except (InputError, OSError, MemoryError) as error:
        return "failed", (type(error).__name__, _words(error))
    except Exception as error:  # noqa: BLE001 - whatever it is, the other side says it
        return "failed", (_DEFECT, defects.told(error))
    return "done", result


def _words(error: Exception) -> str:
    if isinstance(error, OSError) and error.strerror:
        where = f"{error.filename2 or error.filename}: " if error.filename else ""
        return f"{where}{error.strerror}"
    return str(error) or type(error).__name__


class _Teller:
    """Tells progress, as often as somebody could read it."""

    def __init__(self, out: IO[bytes]) -> None:
        self._out = out
        self._text = ""
        self._next = 0.0

    def __call__(self, share: float, text: str = "") -> None:
        now = time.monotonic()
        if text == self._text and now < self._next and share < 1.0:
            return
        self._text, self._next = text, now + _EVERY_S
        pickle.dump(("progress", (float(share), text)), self._out)
        self._out.flush()


def _on_term(number: int, frame: object) -> None:
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    raise _Cancelled


def _end_with_parent(stream: IO[bytes]) -> None:
    """End as on a request when whoever started this has ended."""
    stream.read()
    # to the thread that works, which may be waiting for nothing but a signal
    signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGTERM)
    time.sleep(_GRACE_S)
    os._exit(1)


if __name__ == "__main__":
    sys.exit(main())
