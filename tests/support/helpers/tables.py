"""Virtual tables whose controller is served in this process."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from filters.simulation import TableFault, TableModel, TurnTable
from helpers.processes import LIMIT_S
from imutui.table.acutrol import Acutrol, connect
from imutui.table.acutrol_virtual import VirtualAcutrol
from imutui.table.motion import RESTS_DPS, TableState
from imutui.table.server import BUS, TCP, TableServer


@dataclass
class Served:
    """A table, its controller's server, its URL, and what it was told, as a log has it."""

    table: TurnTable
    server: TableServer
    url: str
    told: list[str]

    def connected(self) -> Acutrol:
        return connect(self.url)


@contextmanager
def served(
    model: TableModel | None = None, *faults: TableFault, prefix: bytes = TCP, speed: float = 1.0
) -> Iterator[Served]:
    """Serve a table; over a "serial line" where it speaks as on a bus."""
    began, told = time.monotonic(), list[str]()
    table = TurnTable(model or TableModel(seed=3))
    server = TableServer(
        VirtualAcutrol(table, faults), ("127.0.0.1", 0), lambda: (time.monotonic() - began) * speed,
        prefix=prefix, faults=faults, log=told.append,
    )  # fmt: skip
    with server:
        where = f"127.0.0.1:{server.port}"
        url = f"acutrol+serial:socket://{where}" if prefix == BUS else f"acutrol://{where}"
        yield Served(table, server, url, told)


def rests(state: TableState) -> bool:
    """Return whether all axes stand still."""
    return all(abs(rate) < RESTS_DPS for rate in state.rates_dps)


def strike(it: Served, fault: TableFault) -> None:
    """Have a fault happen now."""
    now = TableFault(it.server.known(), fault.kind, fault.axis, fault.seconds)
    of_link = fault.kind in ("silent", "cut")
    (it.server._of_link if of_link else it.server._controller._faults).append(now)


def wait_for(controller: Acutrol, what: Callable[[TableState], bool]) -> TableState:
    """Read until a state is so."""
    deadline = time.monotonic() + LIMIT_S
    while not what(state := controller.read()):
        assert time.monotonic() < deadline, state
    return state
