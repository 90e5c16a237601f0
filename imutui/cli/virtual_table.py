"""The virtual table on which `imutui virtual --controller` puts its unit, and the port of its controller."""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from filters.errors import InputError
from filters.motion.segments import AXES
from filters.simulation import OnTable, Scenario, TurnTable
from filters.types import Array
from imutui.instrument.virtual_instrument import VirtualInstrument
from imutui.table.acutrol_virtual import VirtualAcutrol
from imutui.table.server import TableServer

# wall time; at 20 times its speed a unit of 133 readings a second then makes ten at once
_AHEAD_S = 0.004
_SWITCH_S = 0.0005


class VirtualTable:
    """A table with a controller on a loopback port; both share the time of the unit.

    `address`: HOST:PORT; port 0 takes a free one.
    `axes`: number of axes; None: as many as the scenario has.
    `speed`: speed of the time of table and unit over the wall clock's.
    Raises InputError for another address or number of axes.
    """

    def __init__(self, address: str, axes: int | None, speed: float) -> None:
        host, _, port = address.rpartition(":")
        if not host or not port.isdigit() or int(port) > 65535:
            raise InputError(f'--controller is "{address}"; it is HOST:PORT on loopback, such as 127.0.0.1:0')
        if axes is not None and not 1 <= axes <= len(AXES):
            raise InputError(f"--axes is {axes}; a table has 1 to {len(AXES)}")
        self.began = time.monotonic()  # time zero of table and unit
        self._address, self._axes, self._speed = (host.strip("[]"), int(port)), axes, speed
        self._server: TableServer | None = None
        self._unit: VirtualInstrument[Any, Any] | None = None

    def under(self, scenario: Scenario, log: Callable[[str], None] = lambda text: None) -> OnTable:
        """Return the table of a scenario for a unit to stand on, and open the controller's port."""
        model = replace(scenario.table, seed=scenario.table.seed or scenario.seed)
        if self._axes is not None:
            model = replace(model, axes=AXES[-self._axes :])
        table, faults = TurnTable(model), scenario.table_faults
        controller = VirtualAcutrol(table, faults)
        try:
            self._server = TableServer(
                controller, self._address, self._now, faults=faults, ahead_s=_AHEAD_S * self._speed, log=log
            )
        except OSError as error:
            where = ":".join(map(str, self._address))
            raise InputError(
                f"--controller {where} can't be served: {error.strerror}. Port 0 is a free one."
            ) from error
        return OnTable(table, self._at, self._known)

    @contextmanager
    def served(self, unit: VirtualInstrument[Any, Any]) -> Iterator[str]:
        """Serve the controller while the unit runs on the table; yields its URL."""
        assert self._server is not None, "the unit was made without the table"
        self._unit = unit
        # unit and controller are threads of one process; neither may wait for the other's arithmetic
        sys.setswitchinterval(_SWITCH_S)
        with self._server:
            host = self._address[0]
            yield f"acutrol://{f'[{host}]' if ':' in host else host}:{self._server.port}"

    def _now(self) -> float:
        return (time.monotonic() - self.began) * self._speed

    # the unit counts its time from its first reading, by its own clock

    def _clock(self) -> tuple[float, float]:
        """Return when the unit's time begins by its own clock, s, and the speed of this clock over the table's."""
        if self._unit is None or not self._unit.data_asked_for:
            return 0.0, 1.0
        return self._unit.source_begins, 1.0 + self._unit.options.clock_skew_ppm * 1e-6

    def _at(self, t: Array) -> Array:
        begins, faster = self._clock()
        return np.asarray((t + begins) / faster)

    def _known(self) -> float:
        assert self._server is not None, "readings are made when the table is there"
        begins, faster = self._clock()
        return self._server.known() * faster - begins
