"""Rows by a cluster: the only user of dask.distributed, which is an extra.

Scheduler and workers are started by dask's own commands; this is a client of theirs. A task is a path and comes back as
a row, so that nothing but small records crosses the network. A worker that dies costs nothing: the scheduler gives what
it was on to another one.
"""

import importlib.util
import logging
import os
import re
import time
import uuid
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, cast

from filters.errors import InputError
from imutui.jobs.campaign import one_log
from imutui.jobs.campaign.one_log import Rows, Task
from imutui.jobs.campaign.rows import Row

if TYPE_CHECKING:
    from distributed import Client

_CONNECT_S = 10.0
_WORKERS_S = 60.0
_LOOK_S = 5.0
_AHEAD = 2
_ADDRESS = re.compile(r"(tcp|tls|ucx|wss?)://[^\s/]+:[0-9]{1,5}")
_KILLED = "each worker that had it was killed, as happens when memory runs out. Fewer workers leave each one more"
_PACKAGES = ("imutui", "numpy", "numba", "python")


class ClusterError(Exception):
    """The cluster cannot be used; the message says why, and what to do."""


def available() -> bool:
    """Whether dask.distributed is installed; loads nothing."""
    return importlib.util.find_spec("distributed") is not None


def rows(tasks: Iterator[Task], count: int, *, address: str, root: str, say: Callable[[str], None]) -> Rows:
    """Yield rows as the workers of a scheduler have them ready.

    `count`: not used; a cluster has as many workers as it has.
    `address`: of the scheduler, such as tcp://host:8786.
    `root`: folder of the logs, which workers must see under the same name.
    `say`: called with what is worth knowing, a sentence.
    Raises ClusterError if the scheduler does not answer or goes away, there is no worker, or workers have other
      versions or do not see the logs.
    """
    client = _connected(address)
    try:
        _wait_for_workers(client, address, say)
        _check_versions(client)
        _check_root(client, root, say)
        _warm_up(client)
        yield from _fed(client, tasks, address)
    finally:
        client.close(timeout=2)


def _connected(address: str) -> "Client":
    if _ADDRESS.fullmatch(address) is None:
        raise InputError(f'--cluster is "{address}", not an address such as tcp://host:8786')
    from distributed import Client

    # it writes of what is told here, in words for its developers; its import has given its loggers their levels
    for name in ("distributed", *(own for own in logging.root.manager.loggerDict if own.startswith("distributed."))):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        return Client(address, timeout=_CONNECT_S, set_as_default=False)
    except (OSError, TimeoutError) as error:
        raise ClusterError(
            f"no scheduler answers at {address}. Start one with `dask scheduler` and name the address that it prints,"
            " and workers with `dask worker ADDRESS`."
        ) from error


def _wait_for_workers(client: "Client", address: str, say: Callable[[str], None]) -> None:
    how = f"dask worker {address} --nworkers N --nthreads 1"
    if not _threads(client):
        say(f"the scheduler at {address} has no worker yet: waiting {_WORKERS_S:.0f} s for one. Start some: {how}")
    try:
        client.wait_for_workers(1, timeout=_WORKERS_S)
    except TimeoutError as error:
        raise ClusterError(f"the scheduler at {address} has no worker. Start some: {how}") from error


def _check_versions(client: "Client") -> None:
    """Refuse workers whose numbers might be others, or that have no imutui."""
    found = cast("dict[str, Any]", client.get_versions(packages=["imutui", "numba"]))
    for worker, its in sorted(found["workers"].items()):
        told = _difference(its["packages"])
        if told:
            raise ClusterError(f"the worker {worker} {told}. Install the same versions there and start it again.")


def _difference(worker: Mapping[str, object]) -> str:
    """What a worker has that is not as here, in words; empty if all is. Of Python, the last number does not count."""
    own: Mapping[str, object] = one_log.versions()
    for package in _PACKAGES:
        there, here = worker.get(package), own[package]
        if there is None:
            return f"has no {package}"
        if package == "python":
            there, here = (".".join(str(version).split(".")[:2]) for version in (there, here))
        if there != here:
            return f"has {package} {there}, and here it is {here}"
    return ""


def _check_root(client: "Client", root: str, say: Callable[[str], None]) -> None:
    """Refuse a cluster that does not see the logs; say so of a part of it."""
    seen = cast("dict[str, bool]", client.run(os.path.isdir, root))
    blind = sorted(worker for worker, sees in seen.items() if not sees)
    if not blind:
        return
    how = "A log must have the same path on every machine, as on a shared disk."
    if len(blind) == len(seen):
        raise ClusterError(f"no worker sees {root}. {how}")
    say(f"{', '.join(blind)} does not see {root}, and its rows will be errors. {how}")


def _warm_up(client: "Client") -> None:
    """Have one worker of each machine compile what is not compiled there yet, before all of them would."""
    workers = client.scheduler_info()["workers"]
    first = {worker["host"]: address for address, worker in workers.items()}
    ready = [
        client.submit(one_log.prepare, workers=[address], key=f"imutui-prepare-{uuid.uuid4()}", pure=False)
        for address in first.values()
    ]
    client.gather(ready, errors="skip")  # what keeps one from it is said of its first log


def _fed(client: "Client", tasks: Iterator[Task], address: str) -> Rows:
    """Keep so many tasks with the scheduler that its workers always have one, and no more.

    Rows are fetched beside one another: that of a worker which has just died keeps nobody waiting.
    """
    from distributed import as_completed

    run = uuid.uuid4()
    done = as_completed(loop=client.loop, with_results=True, raise_errors=False)
    running: dict[str, Task] = {}
    most, looked, number = 0, -_LOOK_S, 0
    while True:
        if time.monotonic() - looked >= _LOOK_S:
            most, looked = _AHEAD * max(1, _threads(client)), time.monotonic()
        while len(running) < most and (task := next(tasks, None)) is not None:
            future = client.submit(one_log.row_of, task, key=f"imutui-row-{run}-{number}", pure=False)
            running[str(future.key)] = task
            done.add(future)
            number += 1
        if not running:
            return
        future, result = next(done)
        task = running.pop(str(future.key))
        yield task, _row(future.status, result, task, address)


def _row(status: str, result: Any, task: Task, address: str) -> Row | None:
    """Return the row of a task from its future's status and result, which for an error is type, error, traceback."""
    if status in ("cancelled", "lost"):
        raise ClusterError(
            f"the scheduler at {address} has gone. What is done stays in the results: start it again, and then the same"
            " command."
        )
    if status == "error":
        error = result[1]
        words = f"its worker could not compute it ({type(error).__name__}: {error})"
        return one_log.error_row(task, _KILLED if type(error).__name__ == "KilledWorker" else words, retry=True)
    row = cast("Row | None", result)
    if row is not None and (told := _difference(row["versions"])):
        return one_log.error_row(task, f"its worker {told}: install the same versions there", retry=True)
    return row


def _threads(client: "Client") -> int:
    threads: dict[str, int] = client.nthreads()
    return sum(threads.values())
