"""The host's side of the Crossbow protocol: packets and replies in a stream of bytes.

Neither header nor sum makes a packet sure, and letters are payload bytes too: what is looked for is what was asked for.
"""

from functools import partial

from imutui.instrument.counter_spec import SPAN
from imutui.instrument.frame_search import Discarded, FrameDecoder, FrameForm, FrameSearch, Inbox, Search
from imutui.instrument.imu400.crossbow import (
    HEADER,
    LETTER_REPLY,
    PACKET_BYTES,
    SERIAL_BYTES,
    TICK_S,
    AnyCommand,
    AnyReply,
    Command,
    Mode,
    Packet,
    Reply,
    Version,
    ZeroRateSensors,
    checksum,
    is_whole,
    packet_of,
    serial_number_of,
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

# The manual says "ASCII string"; units send 0xFF, text, checksum, and drivers read at most 32 bytes.
_VERSION_BYTES = 32

_PACKET = FrameForm(HEADER, PACKET_BYTES, PACKET_BYTES, lambda head: PACKET_BYTES, is_whole)
_SERIAL_NUMBER = FrameForm(HEADER, SERIAL_BYTES, len(HEADER), lambda head: SERIAL_BYTES, is_whole)


def packet_decoder(mode: Mode, *, streaming: bool) -> FrameDecoder[Packet]:
    """What finds data packets. At most about 200 bytes are held between feeds.

    `mode`: what the unit was told to measure.
    `streaming`: whether packets come by themselves, back to back or at the loop's rate, or one for each
      `Command.GET_PACKET`.
    """
    return FrameDecoder(PacketSearch(mode, streaming=streaming))


def reply_decoder(command: AnyCommand) -> FrameDecoder[AnyReply]:
    """What finds the reply to a command, and discards what is before and behind it.

    `command`: one that is answered by a letter, a serial number or a version.
    Raises ValueError if the unit answers `command` with packets or not at all.
    """
    search: Search[AnyReply]
    if command is Command.SERIAL_NUMBER:
        search = FrameSearch(_SERIAL_NUMBER, serial_number_of, due=0, once=True)
    elif command is Command.VERSION:
        search = _VersionSearch()
    elif isinstance(command, ZeroRateSensors):
        search = _LetterSearch(Reply.RATES_ZEROED)
    elif isinstance(command, Command) and command in LETTER_REPLY:
        search = _LetterSearch(LETTER_REPLY[command])
    else:
        raise ValueError(f"`command` must be one that is answered by a reply, not {command}")
    return FrameDecoder(search)


class PacketSearch(FrameSearch[Packet]):
    """Data packets.

    Neither the header (0xFF is a common byte) nor the sum (one wrong frame in 256 passes) makes a packet of a stream
    sure. A frame with both is accepted if the time counter follows from the packet accepted last, or if another good
    frame, or the reply that was asked for, follows back to back. Otherwise it is set aside, and accepted after all when
    a later frame's counter follows from it: so a good packet between noise is found.

    A polled packet comes alone on a quiet line and has no such witness: its sum is enough.
    """

    def __init__(self, mode: Mode, *, streaming: bool) -> None:
        super().__init__(_PACKET, partial(packet_of, mode), due=None if streaming else 0)
        self._streaming = streaming
        self._last_ticks: int | None = None
        self._period_ticks = NOMINAL_PERIOD_S / TICK_S
        self._set_aside: list[int] = []  # positions of good frames without a witness yet
        self.reply = b""
        """A serial number as it may stand between packets, where the unit was asked for it."""

    def scan(self, inbox: Inbox) -> list[Packet | Discarded]:
        """Packets, with the noise before them: at once those that are where they are due and as they must be."""
        found = list[Packet | Discarded]()
        while frame := self._next(inbox):
            found.append(self._read(frame))  # type: ignore[arg-type]
        return found + super().scan(inbox) if inbox.unjudged else found

    def _next(self, inbox: Inbox) -> bytes:
        """The next frame if nothing is amiss, taken; else nothing, and each byte is to be looked at."""
        at = inbox.start
        if self._due != at or inbox.scan != at or inbox.unjudged < PACKET_BYTES or self.reply or self._set_aside:
            return b""
        frame = inbox.peek(at, PACKET_BYTES)
        ticks = int.from_bytes(frame[15:17], "big")
        if not self._streaming or self._last_ticks is None or frame[:1] != HEADER or not is_whole(frame):
            return b""
        if not self._follows(self._last_ticks, ticks, 0):
            return b""
        self._last_ticks, self._due, self.answers = ticks, at + PACKET_BYTES, 0
        return inbox.take(PACKET_BYTES)

    def close(self, inbox: Inbox) -> list[Packet | Discarded]:
        """Accept a good frame that waited for the next one to vouch for it: on a quiet line none comes."""
        events = [*self._witnessed_by_quiet(inbox), *inbox.drop(inbox.end)]
        self._set_aside.clear()
        if self._due is not None:
            self._due = inbox.end
        return events

    def release(self, inbox: Inbox) -> list[Packet | Discarded]:
        """Accept a good frame that waited for the next one to vouch for it; the beginning of another one stays."""
        return self._witnessed_by_quiet(inbox) + self.scan(inbox)

    def missing(self, inbox: Inbox) -> int:
        """Bytes up to the end of the frame that has begun."""
        return PACKET_BYTES - inbox.unjudged % PACKET_BYTES

    def _witnessed_by_quiet(self, inbox: Inbox) -> list[Packet | Discarded]:
        waits = inbox.unjudged >= PACKET_BYTES
        return self._accept(inbox, inbox.scan, inbox.scan + PACKET_BYTES) if waits else []

    def _kept_from(self, inbox: Inbox) -> int:
        self._set_aside = self._within_reach(inbox.scan)
        return min([inbox.scan, *self._set_aside])

    def _within_reach(self, position: int) -> list[int]:
        return [earlier for earlier in self._set_aside if position - earlier <= _REACH_BYTES]

    def _is_due(self, position: int) -> bool:
        if self._due is None:
            return False
        return position - self._due <= _REACH_BYTES and (position - self._due) % PACKET_BYTES == 0

    def _frames_from(self, inbox: Inbox, at: int, *, paused: bool) -> list[tuple[int, int]] | None:
        reply_at = inbox.find(self.reply, at, at + PACKET_BYTES + SERIAL_BYTES - 1) if self.reply else -1
        if reply_at >= 0:
            # a unit replies between packets: what began before goes on no more
            return [(reply_at, reply_at + SERIAL_BYTES)]
        if inbox.unjudged < PACKET_BYTES:
            return None
        if not _is_packet(inbox, at):
            if self._is_due(at):
                inbox.mark_damaged(at)
            return []
        sure = self._sure_packets(inbox, at)
        if sure == []:
            self._set_aside = [*self._within_reach(at), at]
        return None if sure is None else [(start, start + PACKET_BYTES) for start in sure]

    def _sure_packets(self, inbox: Inbox, position: int) -> list[int] | None:
        """Positions of the packets that the good frame at `position` makes sure; None if more bytes must tell."""
        if not self._streaming or self._follows_last(inbox, position):
            return [position]
        for earlier in reversed(self._within_reach(position)):
            gap = position - (earlier + PACKET_BYTES)
            if gap >= 0 and self._follows(_ticks(inbox, earlier), _ticks(inbox, position), gap):
                return [earlier, position]
        following = position + PACKET_BYTES
        if self.reply and inbox.peek(following, SERIAL_BYTES) == self.reply:
            return [position]
        if inbox.end > following and inbox.peek(following, 1) != HEADER:
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
            off = (step - expected) % SPAN
            if min(off, SPAN - off) <= _STEP_TOLERANCE * expected:
                return True
        return False

    def _explain(self, earlier: int, later: int) -> None:
        """Learn the period from two packets back to back, unless the known one explains them already.

        A line that takes two and a half periods a packet makes steps of two and of three; either alone would mislead.
        """
        step = (earlier - later) % SPAN
        stands_still = step == 0
        if not stands_still and not self._follows(earlier, later, gap=0):
            self._period_ticks = step

    def _accept(self, inbox: Inbox, start: int, end: int) -> list[Packet | Discarded]:
        self._set_aside.clear()
        if end - start == SERIAL_BYTES:
            noise = inbox.drop(start)
            inbox.take(SERIAL_BYTES)
            self._due = inbox.start
            self.answers += 1
            return [*noise]
        self._last_ticks = _ticks(inbox, start)
        return super()._accept(inbox, start, end)


def _is_packet(inbox: Inbox, position: int) -> bool:
    frame = inbox.peek(position, PACKET_BYTES)
    return frame[:1] == HEADER and is_whole(frame)


def _ticks(inbox: Inbox, position: int) -> int:
    return int.from_bytes(inbox.peek(position + 15, 2), "big")


class _LetterSearch(Search[Reply]):
    """A reply of one letter. Letters are payload bytes too, hence only looked for when asked for."""

    def __init__(self, reply: Reply) -> None:
        self._reply = reply

    def scan(self, inbox: Inbox) -> list[Reply | Discarded]:
        """The reply, once its letter has come; all before it is noise."""
        if not inbox.seek(self._reply.value):
            return [*inbox.drop(inbox.end)]
        self.done = True
        events = inbox.drop(inbox.scan)
        inbox.take(1)
        return [*events, self._reply]


class _VersionSearch(Search[Version]):
    """The version text, whose length nobody documents: it ends when the line falls quiet, or with its 32nd byte."""

    def scan(self, inbox: Inbox) -> list[Version | Discarded]:
        """The version, once so much has come that it must be whole."""
        events: list[Version | Discarded] = []
        while not self.done:
            inbox.seek(HEADER, within=_VERSION_BYTES)
            if inbox.unjudged < _VERSION_BYTES:
                break
            events += self._read(inbox, _VERSION_BYTES)
        return events

    def release(self, inbox: Inbox) -> list[Version | Discarded]:
        """The version from what there is: its length is known by the quiet after it only."""
        return self._read(inbox, inbox.unjudged)

    close = release

    def missing(self, inbox: Inbox) -> int:
        """Bytes up to the longest reply, at most a packet."""
        return min(PACKET_BYTES, _VERSION_BYTES - inbox.unjudged)

    def _read(self, inbox: Inbox, length: int) -> list[Version | Discarded]:
        """Read the next `length` bytes as a whole reply, or discard them."""
        reply = inbox.peek(inbox.scan, length)
        noise, text = _version_text(reply)
        if text is None:
            if reply.startswith(HEADER):
                inbox.mark_damaged(inbox.scan)
            return [*inbox.drop(inbox.scan + length)]
        self.done = True
        events = inbox.drop(inbox.scan + noise)
        inbox.take(length - noise)
        return [*events, Version(text)]


def _version_text(reply: bytes) -> tuple[int, str | None]:
    """Read a version reply: length of the noise before it, and the text if there is one."""
    position = reply.find(HEADER)
    while position >= 0:
        body = reply[position + 1 : -1]
        if body and _is_text(body) and checksum(body) == reply[-1]:
            return position, body.decode("ascii")
        position = reply.find(HEADER, position + 1)
    body = reply.lstrip(HEADER).strip(b"\0\r\n ")
    return 0, body.decode("ascii") if body and _is_text(body) else None


def _is_text(body: bytes) -> bool:
    return all(0x20 <= byte < 0x7F or byte in b"\t\r\n" for byte in body)
