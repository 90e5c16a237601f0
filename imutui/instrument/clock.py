"""Convert the instrument's time counter to sampling instants on the host's monotonic clock; no I/O, reads no clock.

A packet's counter gives its instant to some microseconds, but for whole wraps of 52 ms, or of a second. Its arrival
gives the wraps, unless the host or the line was held up. So a packet that goes on where the last one was is stamped at
once. Any other one opens a new stretch, as the first packet does: its packets are held, a fraction of a second, until
they come no less late than before. The least late of them shows whether the line was late and nothing is missing, or
was silent. The length of the tick stays known.

`host_time` fits the counter to the host's clock, `packet_count` to the grid of packets.
"""

import math
from dataclasses import dataclass
from itertools import accumulate, pairwise

from imutui.instrument.counter_spec import SPAN, CounterSpec
from imutui.instrument.host_time import HostTime
from imutui.instrument.packet_count import PacketGrid

# a stretch opens with at least so many packets, over so long a time without a gain
_FEWEST = 3
_OPENING_NS, _OPENING_PERIODS = 250e6, 2.5
_LONGEST_HOLD_NS, _HOLD_PERIODS = 0.8e9, 4.0
_MOST_HELD = 4096
# a packet that is less late by so much shows that the line still catches up
_GAIN_NS = 2e6
# within an adapter's burst packets gain up to so much
_BURST_NS = 25e6
# one that is later by so much than the one before shows that the line was held up again
_AGAIN_NS = 40e6
# a packet that comes within this part of a wrap needs no arrival to show that none went by unseen
_SOON = 0.888
# the least late packet may still be late by so much
_SLACK_NS = 4e6
# the tick must be known so well to distinguish wraps, as a part of one
_AMBIGUOUS = 0.25
# no unit pauses by itself for less: what is missing on a quiet line was lost
_LONGEST_LOSS_NS, _LOSS_PERIODS = 60e6, 5.5
_LOOP_NS = 7.5e6
_POLL_UNCERTAINTY_NS = 20e6


@dataclass(frozen=True, slots=True)
class Gap:
    """A stretch without packets, or with damaged ones, longer than between two that follow each other."""

    seconds: float  # from the last packet's sampling before it to the first one's after it
    # lost_min, lost_max: bounds of the packets that the unit sent and the host did not get; equal where the bytes
    # decide it
    lost_min: int
    lost_max: int


@dataclass(frozen=True, slots=True)
class Stamp:
    """When a packet's sample was taken."""

    monotonic_ns: int  # host's monotonic clock, ns; never later than the arrival
    by_host: bool  # True if the counter did not help: then the instant is the arrival less the line's time
    uncertainty_ns: int = 0  # greatest distance from the truth
    gap: Gap | None = None  # packets that are missing, or may be, before this one


def arrival_before(host_ns: int, ticks: int, last_ticks: int, counter: CounterSpec) -> int:
    """Return when a packet arrived that was only recognised together with a later one; monotonic, ns.

    `host_ns`: arrival of the later one.
    `ticks`, `last_ticks`: time counters of the earlier and the later one, less than a wrap apart.
    """
    return host_ns - round(counter.step(ticks, last_ticks) * counter.tick_ns)


@dataclass(frozen=True, slots=True)
class _Packet:
    """A packet as it arrived: see `Clock.take`."""

    arrival_ns: float  # less the line's time
    step: int  # ticks since the packet before, less whole wraps
    contiguous: bool
    quiet: bool
    behind: bool
    follows: bool  # byte by byte, and by one packet's step


class Clock:
    """Stamps the packets of a stream, in order.

    `line_ns`: time that a packet spends on the line, subtracted from its arrival.
    `counter`: the packets' counter.
    `polled`: True if packets come on request: then steps are longer than the counter's wrap and only arrivals count.
    `period_ns`: time from packet to packet that the host asked for; 0 if it asked for none.
    """

    def __init__(self, line_ns: float, counter: CounterSpec, *, polled: bool = False, period_ns: float = 0.0) -> None:
        self._line_ns = line_ns
        self._polled = polled
        self._opening_ns = max(_OPENING_NS, _OPENING_PERIODS * period_ns)
        self._longest_hold_ns = max(_LONGEST_HOLD_NS, _HOLD_PERIODS * period_ns)
        self._longest_loss_s = max(_LONGEST_LOSS_NS, _LOSS_PERIODS * period_ns) / 1e9
        self._counter = counter
        self._soon_ns = _SOON * SPAN * counter.tick_ns
        self._time = HostTime(counter)
        self._grid = PacketGrid(line_ns / counter.tick_ns)
        self._ticks: int | None = None
        self._host_ns = 0
        self._opened = False  # True if `_time` and `_grid` hold for the newest stamped packet
        # packets without a stamp, ticks up to the newest, the least late and newest lateness, ns, and the arrival since
        # when none was less late
        self._held: list[_Packet] = []
        self._held_ticks = 0
        self._least_late = self._newest_late = 0.0
        self._since_ns = 0.0
        self._gap_from_ns: int | None = None
        self._last = 0

    @property
    def tick_ns(self) -> float:
        """Length of the counter's tick as estimated so far, ns."""
        return self._time.tick_ns

    def take(
        self,
        ticks: int,
        host_ns: int,
        *,
        contiguous: bool,
        quiet: bool = False,
        behind: bool = False,
        requested_ns: int | None = None,
    ) -> list[Stamp]:
        """Take one packet; return the stamps, as far as they are sure, of the oldest packets that have none.

        `ticks`: its counter, 0 to 65535.
        `host_ns`: monotonic clock when its last byte was read.
        `contiguous`: True if it followed the previous packet without a byte between.
        `quiet`: True if the host waited since then and found the line without a byte.
        `behind`: True if more had arrived already when it was read, so that the host is late.
        `requested_ns`: when it was asked for, of a polled packet.
        """
        arrival = host_ns - self._line_ns
        if self._polled:
            return [self._by_arrival(arrival, requested_ns)]
        step = 0 if self._ticks is None else self._counter.step(self._ticks, ticks)
        soon = host_ns - self._host_ns < self._soon_ns
        self._ticks, self._host_ns = ticks, host_ns
        follows = contiguous and self._opened and self._grid.is_next(step, anywhere=bool(self._held))
        packet = _Packet(arrival, step, contiguous, quiet, behind, follows)
        if not self._held:
            return self._go_on(packet, soon=soon)
        if soon or not self._opened or (follows and not quiet):
            return self._hold(packet)
        # packets that follow, and a backlog, are those of a host or a line that was held up, and is again
        caught_up = self._in_step(self._held) and not self._held[0].follows
        return self._settle(caught_up=caught_up) + self._go_on(packet, soon=soon)

    def due(self, now_ns: int) -> list[Stamp]:
        """Return the stamps of packets that were held while nothing came behind them that could make them sure."""
        return self.release() if self._held and now_ns - self._host_ns > self._opening_ns else []

    def release(self) -> list[Stamp]:
        """Return the stamps of all packets held, by what is known."""
        return self._settle(caught_up=False) if self._held else []

    def interrupt(self, *, lossy: bool = False) -> list[Stamp]:
        """Take note that the next packet opens a new stretch; return the stamps of those held.

        `lossy`: True if packets may have been sent meanwhile: the next stamp has the gap. Otherwise none was asked for.
        """
        stamps = self.release()
        self._gap_from_ns = self._last if lossy and self._last else None
        self._opened, self._ticks = False, None
        return stamps

    # -- a stretch ------------------------------------------------------------------------------------------------

    def _go_on(self, packet: _Packet, *, soon: bool) -> list[Stamp]:
        """Stamp a packet that goes on where the last one was; open a stretch with any other one."""
        late = self._time.lateness(packet.arrival_ns, packet.step)
        if self._opened and ((soon and packet.follows) or self._is_in_time(late)):
            return [self._advance(packet, 0)]
        self._held_ticks, self._least_late, self._newest_late = 0, math.inf, math.inf
        return self._hold(packet)

    def _hold(self, packet: _Packet) -> list[Stamp]:
        """Hold a packet until the line has caught up."""
        if self._opened:
            self._held_ticks += packet.step
            late = self._time.lateness(packet.arrival_ns, self._held_ticks)
        else:
            self._held_ticks += self._opening_step(self._held[-1], packet) if self._held else 0
            late = packet.arrival_ns - (self._held or [packet])[0].arrival_ns - self._held_ticks * self.tick_ns
        self._held.append(packet)
        if late < self._least_late - _GAIN_NS or late > self._newest_late + _AGAIN_NS:
            self._since_ns = packet.arrival_ns
        self._least_late, self._newest_late = min(self._least_late, late), late
        if self._opened and self._is_in_time(late):
            return self._settle(caught_up=True)
        # a backlog takes no time: the packets behind it show how late it was
        if len(self._held) < _FEWEST or (packet.behind and len(self._held) < _MOST_HELD):
            return []
        is_steady = packet.arrival_ns - self._since_ns >= self._opening_ns
        too_long = packet.arrival_ns - self._held[0].arrival_ns > self._longest_hold_ns or packet.behind
        return self._settle(caught_up=True) if is_steady or too_long else []

    def _is_in_time(self, late: float) -> bool:
        return late < SPAN * self.tick_ns - _SLACK_NS

    def _settle(self, *, caught_up: bool) -> list[Stamp]:
        """Stamp the packets held. The least late of them shows how many wraps went by unseen."""
        held, self._held = self._held, []
        if not self._opened:
            return self._open(held)
        most = max(0, math.floor((self._least_late + _SLACK_NS) / (SPAN * self.tick_ns)))
        joint, wraps = self._joint(held, most, caught_up=caught_up)
        stamps = [self._advance(packet, 0) for packet in held[:joint]]
        if wraps and self._least_late * self._time.tick_sd_ns > _AMBIGUOUS * SPAN * self.tick_ns**2:
            # after so long a pause the tick, as far as it is known, does not distinguish wraps
            self._gap_from_ns = self._last
            return stamps + self._open(held[joint:])
        doubt = 0.0 if caught_up else self._least_late
        return stamps + [self._advance(p, wraps if k == 0 else 0, doubt) for k, p in enumerate(held[joint:])]

    def _in_step(self, held: list[_Packet]) -> bool:
        """Return True if packets came no faster than the unit sends: those of a backlog are less and less late."""
        return self._time.lateness(held[0].arrival_ns, held[0].step) - self._least_late < _BURST_NS

    def _joint(self, held: list[_Packet], most: int, *, caught_up: bool) -> tuple[int, int]:
        """Return the index of the packet that has unseen wraps before it, and their number, `most` of them.

        It is the first one if they came in step, else one that does not follow. Unless the line has caught up, there
        are no more wraps than the counter demands.
        """
        broken = [k for k, packet in enumerate(held) if not packet.follows]
        if most == 0 or not (caught_up or broken):
            return 0, 0
        regular = [k for k in broken if self._grid.place(held[k].step + SPAN * most)[1]]
        joint = 0 if self._in_step(held) else (regular or broken or [0])[-1]
        least = next((n for n in range(most) if self._grid.place(held[joint].step + SPAN * n)[1]), most)
        return joint, most if caught_up else least

    def _open(self, held: list[_Packet]) -> list[Stamp]:
        """Begin with the least late of the packets held; the length of the tick stays as known."""
        steps = [self._opening_step(before, packet) for before, packet in pairwise(held)]
        known = [step for step, packet in zip(steps, held[1:], strict=True) if packet.contiguous]
        if known:
            self._grid.learn(known)
        self._opened = bool(known) and self._grid.spacing > 0.0
        if not self._opened:
            # too few packets, or a counter that stands still
            self._ticks = None
            return [self._by_arrival(packet.arrival_ns, None) for packet in held]
        self._time.anchor([packet.arrival_ns for packet in held], [*accumulate(steps, initial=0)])
        since, gap = self._gap_from_ns, None
        if since is not None:
            silent = held[0].arrival_ns - since
            gap = Gap(silent / 1e9, 0, math.ceil(silent / (self._grid.spacing * self.tick_ns)))
        self._gap_from_ns = None
        first = self._emit(self._time.instant_ns, held[0], 0, gap, by_host=True)
        wraps = [(step - packet.step) // SPAN for step, packet in zip(steps, held[1:], strict=True)]
        return [first, *map(self._advance, held[1:], wraps)]

    def _opening_step(self, before: _Packet, packet: _Packet) -> int:
        """Return the ticks between two packets of an opening; where bytes are missing, the arrivals give the wraps."""
        if packet.contiguous:
            return packet.step
        late = packet.arrival_ns - before.arrival_ns - packet.step * self.tick_ns
        return packet.step + SPAN * max(0, round(late / (SPAN * self.tick_ns)))

    # -- one stamp ------------------------------------------------------------------------------------------------

    def _advance(self, packet: _Packet, wraps: int, doubt_ns: float = 0.0) -> Stamp:
        """Go on to a packet; return its stamp, with the gap before it."""
        step = packet.step + SPAN * wraps
        packets, regular = self._grid.place(step)
        moved = self._time.advance(step, packet.arrival_ns)
        self._grid.advance(step, packets)
        missing, seconds = packets - 1, step * self.tick_ns / 1e9
        gap = None
        silent = packet.quiet and seconds > self._longest_loss_s
        if silent or (wraps and (packet.quiet or packet.contiguous or not regular)):
            # the unit may have sent nothing meanwhile, or everything
            gap = Gap(seconds, 0, missing + (not regular))
        elif moved > SPAN * self.tick_ns - _SLACK_NS:
            gap = Gap(seconds + moved / 1e9, 0, math.ceil(moved / (self._grid.spacing * self.tick_ns)))
        elif missing:
            # a step that leads off the grid is no number of whole packets
            gap = Gap(seconds, missing if regular else 0, missing + (not regular))
        return self._emit(self._time.instant_ns, packet, step, gap, doubt_ns=doubt_ns)

    def _by_arrival(self, arrival_ns: float, requested_ns: int | None) -> Stamp:
        """Return the stamp of a packet by its arrival: not before it was asked for, nor after it came."""
        uncertain = _POLL_UNCERTAINTY_NS if requested_ns is None else arrival_ns - requested_ns + _LOOP_NS
        self._last = max(self._last + 1, round(arrival_ns))
        return Stamp(self._last, True, round(uncertain))

    def _emit(
        self, at_ns: int, packet: _Packet, step: int, gap: Gap | None, *, by_host: bool = False, doubt_ns: float = 0.0
    ) -> Stamp:
        # a correction backwards must not stop time: the stamp goes on by a quarter of its step, if the arrival allows
        onward = max(at_ns, self._last + round(0.25 * step * self.tick_ns))
        self._last = max(self._last + 1, min(onward, round(packet.arrival_ns)))
        uncertain = round(self._time.uncertainty_ns + doubt_ns) + abs(self._last - at_ns)
        return Stamp(self._last, by_host, uncertain, gap)
