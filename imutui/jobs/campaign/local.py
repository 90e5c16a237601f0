"""Rows on this machine: processes that are started once, warmed once, and each given one log after the other.

Each process is a pool of its own, so that one that is killed takes nothing with it but the log it was on.
"""

import multiprocessing
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from typing import Any

from imutui.jobs import parallel
from imutui.jobs.campaign import one_log
from imutui.jobs.campaign.one_log import Rows, Task

_TRIES = 2
_KILLED = (
    "its process was killed twice on this log, as happens when memory runs out. Fewer --workers leave each one more"
)


def rows(tasks: Iterator[Task], count: int, *, workers: int) -> Rows:
    """Yield rows as they are ready; a process that a log kills is started anew, and the log tried once more."""
    pools = [_pool()]
    with parallel.terminated_in_order():
        try:
            # alone: what it compiles, if anything, the others find done
            _submitted(pools[0], one_log.prepare).result()
            pools += [_pool() for _ in range(min(workers, count) - 1)]
            yield from _fed(tasks, pools)
        except BaseException:
            for process in multiprocessing.active_children():
                process.terminate()
            raise
        finally:
            for pool in pools:
                pool.shutdown(wait=True, cancel_futures=True)


def _fed(tasks: Iterator[Task], pools: list[ProcessPoolExecutor]) -> Rows:
    """Keep each process busy with one log; `pools` is changed where one has to be replaced."""
    again: deque[Task] = deque()
    tries: dict[str, int] = {}
    idle = deque(range(len(pools)))
    running: dict[Future[Any], tuple[int, Task]] = {}
    while True:
        while idle and (task := again.popleft() if again else next(tasks, None)) is not None:
            number = idle.popleft()
            try:
                running[_submitted(pools[number], one_log.row_of, task)] = number, task
            except BrokenProcessPool:  # it was killed while it had nothing to do
                pools[number] = _pool()
                running[_submitted(pools[number], one_log.row_of, task)] = number, task
        if not running:
            return
        for done in wait(running, return_when=FIRST_COMPLETED).done:
            number, task = running.pop(done)
            try:
                row = done.result()
            except BrokenProcessPool:
                pools[number].shutdown(wait=True)
                pools[number] = _pool()
                # first in the row: of the others one may be dead too, and not have said so yet
                idle.appendleft(number)
                tries[task.log] = tries.get(task.log, 0) + 1
                if tries[task.log] < _TRIES:
                    again.append(task)
                    continue
                row = one_log.error_row(task, _KILLED, retry=True)
            else:
                idle.append(number)
            yield task, row


def _pool() -> ProcessPoolExecutor:
    return ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), initializer=parallel.end_with_parent)


def _submitted(pool: ProcessPoolExecutor, function: Callable[..., Any], *arguments: Task) -> Future[Any]:
    with parallel.interrupts_held():  # by the process, which inherits it where this starts it
        return pool.submit(function, *arguments)
