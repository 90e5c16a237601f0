"""One job over many logs, in processes beside one another."""

import contextlib
import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import TypeVar

T = TypeVar("T")
R = TypeVar("R")


def each(job: Callable[[T], R], items: Sequence[T]) -> Iterator[R]:
    """Results in the order of the items; Ctrl+C ends the processes, which say nothing about it themselves.

    `job`: at a module's top level, or a partial of such.
    Raises MemoryError if a process was killed, which the kernel does when memory runs out.
    """
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(min(len(items), os.cpu_count() or 1), context) as pool:
        try:
            with interrupts_held():  # by the processes, which inherit it
                results = [pool.submit(job, item) for item in items]
            for result in results:
                yield result.result()
        except BaseException as error:
            for process in multiprocessing.active_children():
                process.terminate()
            # waits for the pool's own thread: the interpreter's end would wake it while it closes what it is woken by
            pool.shutdown(wait=True, cancel_futures=True)
            if isinstance(error, BrokenProcessPool):
                raise MemoryError("one of the processes was killed, as happens when memory runs out") from error
            raise


@contextlib.contextmanager
def interrupts_held() -> Iterator[None]:
    """Start processes in this block, which inherit that Ctrl+C does not reach them; here it is late, not lost."""
    # ignored meanwhile, one that came just then would be lost
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
