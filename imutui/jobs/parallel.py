"""One job over many logs, in processes that end with the one that started them, however that ends."""

import contextlib
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import TypeVar

T = TypeVar("T")
R = TypeVar("R")


def each(job: Callable[[T], R], items: Sequence[T]) -> Iterator[R]:
    """Yield results in the order of the items; Ctrl+C and SIGTERM end the processes, which print nothing about it.

    `job`: at a module's top level, or a partial of such.
    Raises MemoryError if a process was killed, which the kernel does when memory runs out.
    """
    context = multiprocessing.get_context("spawn")
    count = min(len(items), os.cpu_count() or 1)
    with terminated_in_order(), ProcessPoolExecutor(count, context, initializer=end_with_parent) as pool:
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


def end_with_parent() -> None:
    """Have this process leave Ctrl+C to the one that started it, and end when that one is gone, killed or not."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    assert parent is not None

    def wait() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=wait, name="parent's end", daemon=True).start()


@contextlib.contextmanager
def terminated_in_order() -> Iterator[None]:
    """Let SIGTERM leave this block as SystemExit, so that the block's processes and semaphores go first."""
    if threading.current_thread() is not threading.main_thread() or signal.getsignal(signal.SIGTERM) != signal.SIG_DFL:
        yield
        return
    signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(128 + number))
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
