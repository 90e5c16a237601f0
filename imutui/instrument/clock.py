"""From the instrument's time counter to sampling instants on the host's monotonic clock; no I/O, reads no clock.

A packet's counter says to some microseconds when it was sampled, but not after how many wraps of 52 ms, or of a second;
its arrival tells that, unless the host or the line was held up. So a packet that comes in time, or follows the one
before byte by byte, is stamped at once. After a pause packets are held, a fraction of a second, until those behind them
show whether the line was late, and nothing is missing, or was silent: a backlog comes faster than the unit can send.

`host_time` has the counter against the host's clock, `packet_count` the counter against the grid of packets.
"""

import math
from dataclasses import dataclass
from itertools import accumulate, pairwise

from imutui.instrument.counter_spec import SPAN, CounterSpec
from imutui.instrument.host_time import HostTime
from imutui.instrument.packet_count import PacketGrid

WRAP = SPAN
_FEWEST = 3
_OPENING_NS = 250e6
# a packet that comes so soon after the one before, as a part of a wrap, needs no other witness that none went by unseen
_SOON = 0.888
# a packet may seem so much early where the estimate is off
_SLACK_NS = 4e6
# a line that has caught up no further for so long is in time
_CAUGHT_UP_NS = 120e6
_GAIN_NS = 2e6
# one that is later by so much than the one before was held up again
_AGAIN_NS = 40e6
_LONGEST_HOLD_NS = 0.8e9
_MOST_HELD = 4096
# how well the tick must be known to tell wraps apart after a pause, as a part of one
_AMBIGUOUS = 0.25
# in so short a time no unit pauses by itself: what is missing on a quiet line was lost
_LONGEST_LOSS_NS = 60e6
# where packets are rare, what is waited for is so many of them
_OPENING_PERIODS, _CAUGHT_UP_PERIODS, _HOLD_PERIODS, _LOSS_PERIODS = 2.5, 2.5, 4.0, 5.5
_LOOP_NS = 7.5e6
_POLL_UNCERTAINTY_NS = 20e6


@dataclass(frozen=True, slots=True)
class Gap:
    """A stretch without packets, or with damaged ones, longer than between two that follow each other."""

    seconds: float  # from the last packet's sampling before it to the first one's after it
    # lost_min, lost_max: bounds of how many packets the unit sent and the host did not get: equal where the bytes
    # decide it
    lost_min: int
    lost_max: int


@dataclass(frozen=True, slots=True)
class Stamp:
    """When a packet's sample was taken."""

    monotonic_ns: int  # host's monotonic clock, ns; never later than the arrival
    by_host: bool  # whether the counter could not help, so that the instant is the time of arrival less the line's time
    uncertainty_ns: int = 0  # how far from the truth it may be
    gap: Gap | None = None  # what is missing, or may be, before this one


def arrival_before(host_ns: int, ticks: int, last_ticks: int, counter: CounterSpec) -> int:
    """When a packet arrived that was only recognised together with a later one.

    `host_ns`: when the later one arrived.
    `ticks`, `last_ticks`: time counters of the earlier and the later one, less than a wrap apart.
    `counter`: what they count.
    Returns monotonic, ns.
    """
    return host_ns - round(counter.step(ticks, last_ticks) * counter.tick_ns)


@dataclass(frozen=True, slots=True)
class _Packet:
    """A packet as it arrived: see `Clock.take`; `step` in ticks since the one before, less whole wraps."""

    arrival_ns: float
    step: int
    contiguous: bool
    quiet: bool
    behind: bool
    follows: bool


class Clock:
    """Stamps the packets of a stream, in order.

    `line_ns`: time that a packet spends on the line, subtracted from its arrival.
    `counter`: what the packets' counter counts.
    `polled`: whether packets come on request: then steps are longer than the counter's wrap and arrival alone counts.
    `period_ns`: from packet to packet of the stream, as far as the unit was told; 0 if it was not.
    """

    def __init__(self, line_ns: float, counter: CounterSpec, *, polled: bool = False, period_ns: float = 0.0) -> None:
        self._line_ns = line_ns
        self._polled = polled
        self._opening_ns = max(_OPENING_NS, _OPENING_PERIODS * period_ns)
        self._caught_up_ns = max(_CAUGHT_UP_NS, _CAUGHT_UP_PERIODS * period_ns)
        self._longest_hold_ns = max(_LONGEST_HOLD_NS, _HOLD_PERIODS * period_ns)
        self._longest_loss_s = max(_LONGEST_LOSS_NS, _LOSS_PERIODS * period_ns) / 1e9
        self._counter = counter
        self._soon_ns = _SOON * WRAP * counter.tick_ns
        self._ambiguous_ns = _AMBIGUOUS * WRAP * counter.tick_ns
        self._time = HostTime(counter)
        self._grid = PacketGrid(self._line_ns / counter.tick_ns)
        self._ticks: int | None = None
        self._host_ns = 0
        self._opened = False
        self._held: list[_Packet] = []
        self._held_ticks = 0
        self._least_late = 0.0
        self._least_late_at = 0.0
        self._newest_late = 0.0
        self._emptied = False
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
        """Take one packet; returns stamps of the oldest packets that have none yet, as far as they are sure.

        `ticks`: its counter, 0 to 65535.
        `host_ns`: monotonic clock when its last byte was read.
        `contiguous`: whether it followed the previous packet without a byte between.
        `quiet`: whether the host waited since then, and found the line without a byte.
        `behind`: whether more had arrived already when it was read, so that the host is late.
        `requested_ns`: when it was asked for, of a polled packet.
        """
        arrival = host_ns - self._line_ns
        if self._polled:
            return [self._by_arrival(arrival, requested_ns)]
        step = 0 if self._ticks is None else self._counter.step(self._ticks, ticks)
        soon = host_ns - self._host_ns < self._soon_ns
        self._ticks, self._host_ns = ticks, host_ns
        is_next = self._grid.may_be_next if self._held else self._grid.is_next
        follows = contiguous and soon and self._opened and is_next(step)
        packet = _Packet(arrival, step, contiguous, quiet, behind, follows)
        if not self._opened:
            return self._take_opening(packet)
        if self._held and not soon:
            return self._resume(caught_up=self._in_step() or (quiet and not self._in_a_burst())) + self._take(packet)
        return self._take(packet)

    def due(self, now_ns: int) -> list[Stamp]:
        """Stamps of packets that were held while nothing came behind them that could have made them sure."""
        waited = now_ns - self._host_ns
        return self.release() if self._held and waited > self._opening_ns else []

    def release(self) -> list[Stamp]:
        """Stamps of all packets held, by what is known."""
        if not self._held:
            return []
        return self._resume(caught_up=False) if self._opened else self._open()

    def interrupt(self, *, lossy: bool = False) -> list[Stamp]:
        """Take note that the next packet begins a new stretch; returns stamps of those held.

        The length of the tick stays known.

        `lossy`: whether packets may have been sent meanwhile: the next stamp has the gap. Otherwise none was asked for.
        """
        stamps = self.release()
        self._gap_from_ns = self._last if lossy and self._last else None
        self._opened, self._ticks = False, None
        return stamps

    # -- the first packets of a stretch ---------------------------------------------------------------------------

    def _take_opening(self, packet: _Packet) -> list[Stamp]:
        self._held.append(packet)
        span = packet.arrival_ns - self._held[0].arrival_ns
        # a backlog takes no time: what is behind it tells how late it was
        whole = span >= self._opening_ns and len(self._held) >= _FEWEST and not packet.behind
        return self._open() if whole or len(self._held) >= _MOST_HELD else []

    def _open(self) -> list[Stamp]:
        """Begin with the least late of the packets held."""
        held, self._held = self._held, []
        steps = [0] + [self._opening_step(before, packet) for before, packet in pairwise(held)]
        known = [step for step, packet in zip(steps[1:], held[1:], strict=True) if packet.contiguous]
        if known:
            self._grid.learn(known)
        if not known or not self._grid.known:
            # too few packets, or a counter that stands still
            self._ticks = None
            return [self._by_arrival(packet.arrival_ns, None) for packet in held]
        self._time.anchor([packet.arrival_ns for packet in held], list(accumulate(steps)))
        self._opened = True
        gap, self._gap_from_ns = self._gap_since(self._gap_from_ns, held[0].arrival_ns), None
        at = self._time.instant_ns - round(sum(steps) * self.tick_ns)
        stamps = []
        for step, packet in zip(steps, held, strict=True):
            at += round(step * self.tick_ns)
            lost = self._grid.packets(step, contiguous=packet.contiguous) - 1 if step else 0
            gap = Gap(step * self.tick_ns / 1e9, lost, lost) if lost else gap
            stamps.append(self._emit(at, packet, step, gap, by_host=not step))
            gap = None
        return stamps

    def _opening_step(self, before: _Packet, packet: _Packet) -> int:
        """Ticks between two packets of the opening; wraps by arrival where bytes are missing."""
        if packet.contiguous:
            return packet.step
        late = packet.arrival_ns - before.arrival_ns - packet.step * self.tick_ns
        return packet.step + WRAP * max(0, round(late / (WRAP * self.tick_ns)))

    def _gap_since(self, last_ns: int | None, arrival_ns: float) -> Gap | None:
        if last_ns is None:
            return None
        silent = arrival_ns - last_ns
        return Gap(silent / 1e9, 0, math.ceil(silent / (self._grid.spacing * self.tick_ns)))

    # -- packets after those --------------------------------------------------------------------------------------

    def _take(self, packet: _Packet) -> list[Stamp]:
        wrap_ns = WRAP * self.tick_ns
        if self._held:
            return self._hold(packet)
        late = self._time.lateness(packet.arrival_ns, packet.step)
        if packet.follows or late < wrap_ns - _SLACK_NS:
            return [self._advance(packet, 0)]
        self._held_ticks, self._least_late, self._least_late_at = 0, late, packet.arrival_ns
        self._newest_late = late
        self._emptied = False
        return self._hold(packet)

    def _hold(self, packet: _Packet) -> list[Stamp]:
        """Hold a packet until the line has caught up with the time."""
        self._held.append(packet)
        self._held_ticks += packet.step
        late = self._time.lateness(packet.arrival_ns, self._held_ticks)
        if late < self._least_late - _GAIN_NS:
            self._least_late, self._least_late_at = late, packet.arrival_ns
        self._emptied = self._emptied or not packet.behind
        if (packet.behind and not self._emptied) or late > self._newest_late + _AGAIN_NS:
            # a busy host takes its time over a backlog; once that is read, several at once are an adapter's burst; and
            # while a line is held up again it catches up nothing
            self._least_late_at = packet.arrival_ns
        self._newest_late = late
        in_time = late < WRAP * self.tick_ns - _SLACK_NS
        if in_time or packet.arrival_ns - self._least_late_at > self._caught_up_ns:
            return self._resume(caught_up=True)
        too_long = packet.arrival_ns - self._held[0].arrival_ns > self._longest_hold_ns or len(self._held) >= _MOST_HELD
        return self._resume(caught_up=False) if too_long else []

    def _in_step(self) -> bool:
        """Whether the packets held came no faster than the unit sends."""
        ticks = sum(packet.step for packet in self._held[1:])
        last = self._held[-1]
        in_step = last.arrival_ns - self._held[0].arrival_ns > 0.5 * ticks * self.tick_ns > 0.0
        return in_step and not last.behind

    def _in_a_burst(self) -> bool:
        """Whether the packets held came faster than the unit sends: then the line may be held up again."""
        ticks = sum(packet.step for packet in self._held[1:])
        took_ns = self._held[-1].arrival_ns - self._held[0].arrival_ns
        return len(self._held) > _FEWEST and took_ns < 0.5 * ticks * self.tick_ns

    def _resume(self, *, caught_up: bool) -> list[Stamp]:
        """Stamps of the packets held: how late the least late of them is tells how many wraps went by unseen."""
        held, self._held = self._held, []
        most = max(0, math.floor((self._least_late + _SLACK_NS) / (WRAP * self.tick_ns)))
        joint, wraps = self._joint(held, most, caught_up=caught_up)
        stamps = [self._advance(packet, 0) for packet in held[:joint]]
        if wraps and self._least_late * self._time.tick_sd_ns / self.tick_ns > self._ambiguous_ns:
            # so long a pause that the tick, as far as it is known, can't tell wraps apart: begin anew
            self._gap_from_ns, self._opened, self._held = self._last, False, held[joint:]
            return stamps
        doubt = 0.0 if caught_up else self._least_late
        return stamps + [self._advance(p, wraps if k == 0 else 0, doubt) for k, p in enumerate(held[joint:])]

    def _joint(self, held: list[_Packet], most: int, *, caught_up: bool) -> tuple[int, int]:
        """Which packet held has unseen wraps before it, and how many.

        A line that has caught up shows the number, and the packet is the one that did not follow byte by byte. Before
        that there are no more than the counter demands.
        """
        grid = self._grid
        broken = [
            k for k, p in enumerate(held) if not (p.follows or (k == 0 and p.contiguous and grid.is_next(p.step)))
        ]
        if most == 0 or (not caught_up and not broken):
            return 0, 0
        regular = [k for k in broken if grid.is_regular(held[k].step + WRAP * most)]
        joint = (regular or broken or [0])[-1]
        if caught_up:
            return joint, most
        return joint, next((n for n in range(most) if grid.is_regular(held[joint].step + WRAP * n)), most)

    # -- one stamp ------------------------------------------------------------------------------------------------

    def _advance(self, packet: _Packet, wraps: int, doubt_ns: float = 0.0) -> Stamp:
        """Go on to a packet; returns its stamp, with what is missing before it."""
        step = packet.step + WRAP * wraps
        packets, regular = self._grid.place(step)
        moved = self._time.advance(step, packet.arrival_ns)
        self._grid.advance(step, packets)
        missing, seconds = packets - 1, step * self.tick_ns / 1e9
        gap = None
        silent = packet.quiet and seconds > self._longest_loss_s
        if silent or (wraps and (packet.quiet or packet.contiguous or not regular)):
            # the unit may have sent nothing meanwhile, or everything
            gap = Gap(seconds, 0, missing + (not regular))
        elif moved > WRAP * self.tick_ns - _SLACK_NS:
            gap = Gap(seconds + moved / 1e9, 0, math.ceil(moved / (self._grid.spacing * self.tick_ns)))
        elif missing:
            # what leads off the grid is no number of whole packets
            gap = Gap(seconds, missing if regular else 0, missing + (not regular))
        return self._emit(self._time.instant_ns, packet, step, gap, doubt_ns=doubt_ns)

    def _by_arrival(self, arrival_ns: float, requested_ns: int | None) -> Stamp:
        """Stamp of a packet whose counter says nothing: not before it was asked for, nor after it came."""
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
