"""A virtual unit and its line as one, on the host's time: what a host sends goes in, what reaches it comes out.

No clock and no I/O. The unit's own time is the host's, faster by `speed` and by the skew of the unit's clock.
"""

import math
from collections.abc import Callable
from typing import Generic

from imutui.instrument.faults import FaultyLine, LineFault
from imutui.instrument.transmitter import SAME_INSTANT_S, transfer_s
from imutui.instrument.virtual_instrument import CommandT, PacketT, VirtualInstrument


class Wire(Generic[PacketT, CommandT]):
    """A unit, its line, and the faults of both.

    Times are seconds since the unit's begin, on the host's clock; they never go back.

    `unit`: the unit; it is at its time 0.
    `line`: what happens to bytes on their way, and when the unit and its port have faults; nothing without it.
    `speed`: unit time over the host's.
    `on_packet`: told of every packet that the unit begins to send, and of the host's time when it was sampled.
    """

    def __init__(
        self,
        unit: VirtualInstrument[PacketT, CommandT],
        line: FaultyLine | None = None,
        speed: float = 1.0,
        on_packet: Callable[[PacketT, float], None] | None = None,
    ) -> None:
        self._unit = unit
        self._line = FaultyLine(()) if line is None else line
        self._rate = speed * (1.0 + unit.options.clock_skew_ppm * 1e-6)
        self._now = 0.0
        if on_packet is not None:
            unit.on_packet = lambda packet, instant: on_packet(packet, instant / self._rate)

    def receive(self, data: bytes, now: float, host_baud: int) -> list[CommandT]:
        """Let bytes from the host arrive, all by `now`, and return what the unit understood."""
        self._carry(now, host_baud)
        commands = self._unit.receive(data, self._at(now), host_baud)
        if self._unit.data_asked_for:
            self._line.started(self._at(now))
        return commands

    def arrived(self, now: float, host_baud: int) -> bytes:
        """Return the bytes that have reached a host at this speed by `now`, each once."""
        self._carry(now, host_baud)
        return self._line.take(self._at(now))

    def forget(self, before: float, host_baud: int) -> None:
        """Lose what left the unit before a time and was not asked for: a host that was held up too long."""
        self._unit.transmit(self._at(before), host_baud)

    def next_event(self) -> float | None:
        """Return when bytes will next arrive or leave; None if there are none until the next command."""
        events = (self._unit.next_event(self._now), self._line.next_event(), self._line.next_for_unit())
        due = min((event for event in events if event is not None), default=math.inf)
        return None if due == math.inf else due / self._rate

    def is_away(self, now: float) -> bool:
        """Whether there is no port."""
        return self._line.is_away(self._at(now))

    def next_port_change(self, now: float) -> float:
        """When the port will next go or come; infinite if never."""
        return self._line.next_port_change(self._at(now)) / self._rate

    def _at(self, now: float) -> float:
        """The unit's time; just after it, so that no rounding makes it come before what is due then."""
        return now * self._rate + SAME_INSTANT_S

    def _carry(self, now: float, host_baud: int) -> None:
        """Put what has left the unit on the line, message by message: faults and losses are of whole ones."""
        until = self._at(now)
        while True:
            left, fault = self._unit.next_event(self._now), self._line.next_for_unit()
            if fault <= until and (left is None or fault < left):
                self._now = max(self._now, fault)
                self._suffer(self._line.take_for_unit())
            elif left is not None and left <= until:
                message = self._unit.transmit(left, host_baud)
                sent = left - transfer_s(len(message), self._unit.baud)
                self._line.put(message, sent, left, packet_bytes=self._unit.packet_bytes)
                self._now = max(self._now, left)
            else:
                break
        self._now = max(self._now, until)

    def _suffer(self, fault: LineFault) -> None:
        match fault.kind:
            case "reset":
                self._unit.power_up(self._now, fault.serial_number)
            case "mode_change":
                self._unit.change_mode(self._now)
            case "pause":
                self._unit.pause(self._now, fault.seconds)
            case "hang_up" if fault.power or fault.serial_number is not None:
                self._unit.power_up(self._now, fault.serial_number)
