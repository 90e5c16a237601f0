"""Finding data packets in a stream of bytes in which neither the header nor the sum makes a packet sure."""

from imutui.instrument.imu400.inbox import Inbox
from imutui.instrument.imu400.messages import (
    COUNTER_SPAN,
    HEADER,
    PACKET_BYTES,
    SERIAL_BYTES,
    TICK_S,
    Event,
    Mode,
    SerialNumber,
    checksum,
    encode,
    packet_of,
)

# "Up to 133 Hz", 7.5 ms: the period assumed until packets back to back tell another.
NOMINAL_PERIOD_S = 7.5e-3

# A packet follows from an earlier one when the counter stepped by a few whole periods, within 2 %: by 3 at most (the
# newest sample, when the line is slower than the unit's loop), one more for every 18 bytes between them, and never by
# more than 6, since a seventh would wrap. Each period allowed lets in more wrong frames, hence no more than needed.
_STEP_TOLERANCE = 0.02
_ADJACENT_PERIODS = 3
_MOST_PERIODS = 6

# How far, in bytes, an accepted packet can vouch for a later one: the six packets above, and two of noise.
_REACH_BYTES = (_MOST_PERIODS + 2) * PACKET_BYTES


class PacketSearch:
    """Data packets.

    Neither the header (0xFF is a common byte) nor the sum (one wrong frame in 256 passes) makes a packet of a stream
    sure. A frame with both is accepted if the time counter follows from the packet accepted last, or if another good
    frame follows back to back. Otherwise it is set aside, and accepted after all when a later frame's counter follows
    from it: so a good packet between noise is found. After a bad frame the search slides by one byte, since the true
    header may be among the bytes of a false one.

    A polled packet comes alone on a quiet line and has no such witness: its sum is enough.
    """

    done = False

    def __init__(self, mode: Mode, *, streaming: bool, due: int) -> None:
        self._mode = mode
        self._streaming = streaming
        self._due = None if streaming else due  # where the last good packet ended, hence the next one is due
        self._last_ticks: int | None = None
        self._period_ticks = NOMINAL_PERIOD_S / TICK_S
        self._set_aside: list[int] = []  # positions of good frames without a witness yet
        self.reply: SerialNumber | None = None
        """May stand between packets, where the unit was asked for it."""

    def scan(self, inbox: Inbox) -> list[Event]:
        """Packets that are sure by now, with the noise before them; a frame that nothing vouches for yet is left."""
        events: list[Event] = []
        while inbox.seek(HEADER):
            at = -1 if self.reply is None else inbox.find(encode(self.reply))
            if self.reply is not None and 0 <= at < inbox.scan + PACKET_BYTES:
                # a unit replies between packets: what began before goes on no more
                events += [*inbox.drop(at), self.reply]
                inbox.take(SERIAL_BYTES)
                self._due = inbox.start
                continue
            if inbox.unjudged < PACKET_BYTES:
                break
            if not _is_packet(inbox, inbox.scan):
                if self._is_due(inbox.scan):
                    inbox.mark_damaged()
                inbox.scan += 1
                continue
            sure = self._sure_packets(inbox, inbox.scan)
            if sure is None:
                break
            for position in sure:
                events += self._accept(inbox, position)
            if not sure:
                self._set_aside = [*self._within_reach(inbox.scan), inbox.scan]
                inbox.scan += 1
        else:
            inbox.scan = inbox.end
        self._set_aside = self._within_reach(inbox.scan)
        return events + inbox.drop(min([inbox.scan, *self._set_aside]))

    def close(self, inbox: Inbox) -> list[Event]:
        """Accept a good frame that waited for the next one to vouch for it: on a quiet line none comes."""
        waits_for_witness = inbox.unjudged >= PACKET_BYTES
        events = self._accept(inbox, inbox.scan) if waits_for_witness else []
        events += inbox.drop(inbox.end)
        self._set_aside.clear()
        if self._due is not None:
            self._due = inbox.end
        return events

    def release(self, inbox: Inbox) -> list[Event]:
        """Accept a good frame that waited for the next one to vouch for it; the beginning of another one stays."""
        waits_for_witness = inbox.unjudged >= PACKET_BYTES
        events = self._accept(inbox, inbox.scan) if waits_for_witness else []
        return events + self.scan(inbox)

    def missing(self, inbox: Inbox) -> int:
        """Bytes up to the end of the frame that has begun."""
        return PACKET_BYTES - inbox.unjudged % PACKET_BYTES

    def _within_reach(self, position: int) -> list[int]:
        return [earlier for earlier in self._set_aside if position - earlier <= _REACH_BYTES]

    def _is_due(self, position: int) -> bool:
        if self._due is None:
            return False
        return position - self._due <= _REACH_BYTES and (position - self._due) % PACKET_BYTES == 0

    def _sure_packets(self, inbox: Inbox, position: int) -> list[int] | None:
        """Positions of the packets that the good frame at `position` makes sure; None if more bytes must tell."""
        if not self._streaming or self._follows_last(inbox, position):
            return [position]
        for earlier in reversed(self._within_reach(position)):
            gap = position - (earlier + PACKET_BYTES)
            if gap >= 0 and self._follows(_ticks(inbox, earlier), _ticks(inbox, position), gap):
                return [earlier, position]
        following = position + PACKET_BYTES
        if inbox.end > following and inbox.peek(following, 1)[0] != HEADER:
            return []
        if inbox.end < following + PACKET_BYTES:
            return None
        if not _is_packet(inbox, following):
            return []
        self._explain(_ticks(inbox, position), _ticks(inbox, following))
        return [position, following]

    def _follows_last(self, inbox: Inbox, position: int) -> bool:
        if self._due is None or self._last_ticks is None:
            return False
        gap = position - self._due
        return gap <= _REACH_BYTES and self._follows(self._last_ticks, _ticks(inbox, position), gap)

    def _follows(self, earlier: int, later: int, gap: int) -> bool:
        """Whether the counter stepped down by whole periods, as many as a `gap` in bytes makes likely."""
        step = earlier - later
        for periods in range(1, min(_MOST_PERIODS, _ADJACENT_PERIODS + gap // PACKET_BYTES) + 1):
            expected = periods * self._period_ticks
            off = (step - expected) % COUNTER_SPAN
            if min(off, COUNTER_SPAN - off) <= _STEP_TOLERANCE * expected:
                return True
        return False

    def _explain(self, earlier: int, later: int) -> None:
        """Learn the period from two packets back to back, unless the known one explains them already.

        A line that takes two and a half periods a packet makes steps of two and of three; either alone would mislead.
        """
        step = (earlier - later) % COUNTER_SPAN
        stands_still = step == 0
        if not stands_still and not self._follows(earlier, later, gap=0):
            self._period_ticks = step

    def _accept(self, inbox: Inbox, position: int) -> list[Event]:
        noise = inbox.drop(position)
        packet = packet_of(self._mode, inbox.take(PACKET_BYTES))
        self._due = inbox.start
        self._last_ticks = packet.ticks
        self._set_aside.clear()
        return [*noise, packet]


def _is_packet(inbox: Inbox, position: int) -> bool:
    frame = inbox.peek(position, PACKET_BYTES)
    return frame[0] == HEADER and checksum(frame[1:-1]) == frame[-1]


def _ticks(inbox: Inbox, position: int) -> int:
    return int.from_bytes(inbox.peek(position + 15, 2), "big")
