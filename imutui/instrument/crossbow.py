"""The Crossbow "DMU" serial protocol of the IMU300CC, IMU400CC and IMU400CD: bytes in, frozen events out.

The module does no input or output, reads no clock, and raises nothing for noise: bytes that mean nothing become a
`Discarded` event and a counter. It knows both ends of the line. `Decoder` is the host's side (packets and replies),
`CommandDecoder` the unit's side, and `encode` writes anything either of them reads; messages stand in `messages`, units
in `scaling`, and all names can be had from here.
"""

from typing import Protocol

from imutui.instrument.messages import (
    BITS_PER_BYTE,
    COMMAND_OF_BYTE,
    COUNTER_SPAN,
    HEADER,
    PACKET_BYTES,
    POWER_UP_BAUD,
    REPLY_LETTERS,
    SERIAL_BYTES,
    SERIAL_WORD,
    TICK_S,
    ZERO_LETTER,
    AskSerialNumber,
    AskVersion,
    BaudReady,
    BaudSet,
    Command,
    Discarded,
    Event,
    GetPacket,
    MeasureBaud,
    Mode,
    ModeSet,
    Packet,
    Ping,
    Pong,
    RatesZeroed,
    Reply,
    RequestBaud,
    SerialNumber,
    SetMode,
    StartStream,
    StopStream,
    UnknownCommand,
    Version,
    ZeroRateSensors,
    checksum,
    encode,
    packet_of,
)
from imutui.instrument.scaling import Scaling

__all__ = [
    "BITS_PER_BYTE",
    "COUNTER_SPAN",
    "HEADER",
    "PACKET_BYTES",
    "POWER_UP_BAUD",
    "TICK_S",
    "AskSerialNumber",
    "AskVersion",
    "BaudReady",
    "BaudSet",
    "Command",
    "CommandDecoder",
    "Decoder",
    "Discarded",
    "Event",
    "GetPacket",
    "MeasureBaud",
    "Mode",
    "ModeSet",
    "Packet",
    "Ping",
    "Pong",
    "RatesZeroed",
    "Reply",
    "RequestBaud",
    "Scaling",
    "SerialNumber",
    "SetMode",
    "StartStream",
    "StopStream",
    "UnknownCommand",
    "Version",
    "ZeroRateSensors",
    "checksum",
    "encode",
]

# The manual says "ASCII string"; units send 0xFF, text, checksum, and drivers read at most 32 bytes.
_VERSION_BYTES = 32

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


# ----------------------------------------------------------------------------------------------------- the host's side


class _Inbox:
    """Bytes received and not yet handed out, each known by its position in everything ever received.

    `start` is the first byte held, `scan` the first one not yet judged, `end` the one that comes next.
    """

    def __init__(self) -> None:
        self._held = bytearray()
        self._damaged: list[int] = []
        self.start = 0
        self.scan = 0
        self.bad_checksums = 0
        self.discarded_bytes = 0

    @property
    def end(self) -> int:
        return self.start + len(self._held)

    @property
    def unjudged(self) -> int:
        return self.end - self.scan

    def append(self, data: bytes) -> None:
        self._held += data

    def peek(self, position: int, length: int) -> bytes:
        first = position - self.start
        return bytes(self._held[first : first + length])

    def seek(self, byte: int, within: int | None = None) -> bool:
        """Move `scan` to the next `byte`; without one (`within` so many bytes) leave it and say so."""
        first = self.scan - self.start
        found = self._held.find(byte, first, len(self._held) if within is None else first + within)
        if found >= 0:
            self.scan = self.start + found
        return found >= 0

    def mark_damaged(self) -> None:
        """Count the frame at `scan` as one that was due and came with a wrong sum."""
        self.bad_checksums += 1
        self._damaged.append(self.scan)

    def take(self, length: int) -> bytes:
        """Hand out `length` bytes from `start`."""
        taken = bytes(self._held[:length])
        del self._held[:length]
        self.start += length
        self.scan = self.start
        return taken

    def drop(self, upto: int) -> list[Event]:
        """Discard what lies before position `upto`."""
        if upto <= self.start:
            return []
        damaged = bool(self._damaged) and self._damaged[0] < upto
        self._damaged = [position for position in self._damaged if position >= upto]
        scan = max(self.scan, upto)
        data = self.take(upto - self.start)
        self.scan = scan
        self.discarded_bytes += len(data)
        return [Discarded(data, damaged)]


class _Search(Protocol):
    """What the decoder looks for in the inbox."""

    def scan(self, inbox: _Inbox) -> list[Event]:
        """Return what can be told from the bytes so far, and leave the rest."""
        ...

    def close(self, inbox: _Inbox) -> list[Event]:
        """Return what can be told knowing that the line is quiet."""
        ...

    def missing(self, inbox: _Inbox) -> int:
        """Bytes needed before `scan` can tell more."""
        ...

    @property
    def done(self) -> bool:
        """Whether nothing more is expected."""
        ...


class _NothingSearch:
    """Nothing is expected: whatever comes is discarded."""

    done = False

    def scan(self, inbox: _Inbox) -> list[Event]:
        return inbox.drop(inbox.end)

    def close(self, inbox: _Inbox) -> list[Event]:
        return self.scan(inbox)

    def missing(self, inbox: _Inbox) -> int:
        return 1


class _LetterSearch:
    """A reply of one letter. Letters are payload bytes too, hence only looked for when asked for."""

    def __init__(self, reply: Reply) -> None:
        self._reply = reply
        self._letter = REPLY_LETTERS[reply][0]
        self.done = False

    def scan(self, inbox: _Inbox) -> list[Event]:
        if not inbox.seek(self._letter):
            return inbox.drop(inbox.end)
        self.done = True
        events = inbox.drop(inbox.scan)
        inbox.take(1)
        return [*events, self._reply]

    def close(self, inbox: _Inbox) -> list[Event]:
        return []

    def missing(self, inbox: _Inbox) -> int:
        return 1


class _SerialNumberSearch:
    """The serial number: header, 32-bit word, checksum."""

    def __init__(self, due: int) -> None:
        self._due = due
        self.done = False

    def scan(self, inbox: _Inbox) -> list[Event]:
        while inbox.seek(HEADER):
            if inbox.unjudged < SERIAL_BYTES:
                return inbox.drop(inbox.scan)
            frame = inbox.peek(inbox.scan, SERIAL_BYTES)
            if checksum(frame[1:-1]) == frame[-1]:
                self.done = True
                events = inbox.drop(inbox.scan)
                inbox.take(SERIAL_BYTES)
                return [*events, SerialNumber(SERIAL_WORD.unpack(frame[1:-1])[0])]
            if inbox.scan == self._due:
                inbox.mark_damaged()
            inbox.scan += 1
        return inbox.drop(inbox.end)

    def close(self, inbox: _Inbox) -> list[Event]:
        self._due = inbox.end
        return []

    def missing(self, inbox: _Inbox) -> int:
        return SERIAL_BYTES - inbox.unjudged


class _VersionSearch:
    """The version text, whose length nobody documents: it ends when the line falls quiet, or with its 32nd byte."""

    done = False

    def scan(self, inbox: _Inbox) -> list[Event]:
        events: list[Event] = []
        while not self.done:
            inbox.seek(HEADER, within=_VERSION_BYTES)
            if inbox.unjudged < _VERSION_BYTES:
                break
            events += self._read(inbox, _VERSION_BYTES)
        return events

    def close(self, inbox: _Inbox) -> list[Event]:
        return self._read(inbox, inbox.unjudged)

    def missing(self, inbox: _Inbox) -> int:
        return min(PACKET_BYTES, _VERSION_BYTES - inbox.unjudged)

    def _read(self, inbox: _Inbox, length: int) -> list[Event]:
        """Read the next `length` bytes as a whole reply, or discard them."""
        reply = inbox.peek(inbox.scan, length)
        noise, text = _version_text(reply)
        if text is None:
            if reply.startswith(bytes([HEADER])):
                inbox.mark_damaged()
            return inbox.drop(inbox.scan + length)
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
    body = reply.lstrip(bytes([HEADER])).strip(b"\0\r\n ")
    return 0, body.decode("ascii") if body and _is_text(body) else None


def _is_text(body: bytes) -> bool:
    return all(0x20 <= byte < 0x7F or byte in b"\t\r\n" for byte in body)


class _PacketSearch:
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

    def scan(self, inbox: _Inbox) -> list[Event]:
        events: list[Event] = []
        while inbox.seek(HEADER):
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

    def close(self, inbox: _Inbox) -> list[Event]:
        waits_for_witness = inbox.unjudged >= PACKET_BYTES
        events = self._accept(inbox, inbox.scan) if waits_for_witness else []
        events += inbox.drop(inbox.end)
        self._set_aside.clear()
        if self._due is not None:
            self._due = inbox.end
        return events

    def missing(self, inbox: _Inbox) -> int:
        return PACKET_BYTES - inbox.unjudged % PACKET_BYTES

    def _within_reach(self, position: int) -> list[int]:
        return [earlier for earlier in self._set_aside if position - earlier <= _REACH_BYTES]

    def _is_due(self, position: int) -> bool:
        if self._due is None:
            return False
        return position - self._due <= _REACH_BYTES and (position - self._due) % PACKET_BYTES == 0

    def _sure_packets(self, inbox: _Inbox, position: int) -> list[int] | None:
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

    def _follows_last(self, inbox: _Inbox, position: int) -> bool:
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

    def _accept(self, inbox: _Inbox, position: int) -> list[Event]:
        noise = inbox.drop(position)
        packet = packet_of(self._mode, inbox.take(PACKET_BYTES))
        self._due = inbox.start
        self._last_ticks = packet.ticks
        self._set_aside.clear()
        return [*noise, packet]


def _is_packet(inbox: _Inbox, position: int) -> bool:
    frame = inbox.peek(position, PACKET_BYTES)
    return frame[0] == HEADER and checksum(frame[1:-1]) == frame[-1]


def _ticks(inbox: _Inbox, position: int) -> int:
    return int.from_bytes(inbox.peek(position + 15, 2), "big")


class Decoder:
    """The host's side: bytes from the unit in, events out.

    What comes out does not depend on how the bytes are cut into feeds, only when. At most about 200 bytes are held
    between feeds. The decoder starts expecting nothing, so that everything is discarded.
    """

    def __init__(self) -> None:
        self._inbox = _Inbox()
        self._search: _Search = _NothingSearch()

    def expect_packets(self, mode: Mode, *, streaming: bool) -> None:
        """Look for data packets from here on, knowing nothing of earlier ones.

        Bytes still held belong to what was expected before: they are discarded with the next feed.

        Parameters
        ----------
        mode : Mode
            What the unit was told to measure.
        streaming : bool
            Whether packets come by themselves, back to back or at the loop's rate, or one for each `GetPacket`.
        """
        self._expect(_PacketSearch(mode, streaming=streaming, due=self._inbox.end))

    def expect_reply(self, command: Command) -> None:
        """Look for the reply to `command` from here on, and after it for nothing.

        Parameters
        ----------
        command : Command
            One that is answered by a letter, a serial number or a version.

        Raises
        ------
        ValueError
            If the unit answers `command` with packets or not at all.
        """
        match command:
            case AskSerialNumber():
                self._expect(_SerialNumberSearch(self._inbox.end))
            case AskVersion():
                self._expect(_VersionSearch())
            case Ping():
                self._expect(_LetterSearch(Pong()))
            case SetMode(mode):
                self._expect(_LetterSearch(ModeSet(mode)))
            case ZeroRateSensors():
                self._expect(_LetterSearch(RatesZeroed()))
            case RequestBaud():
                self._expect(_LetterSearch(BaudReady()))
            case MeasureBaud():
                self._expect(_LetterSearch(BaudSet()))
            case _:
                raise ValueError(f"`command` must be one that is answered by a reply, not {command}")

    def feed(self, data: bytes) -> list[Event]:
        """Take bytes from the line.

        Parameters
        ----------
        data : bytes
            Any number of bytes, cut anywhere.

        Returns
        -------
        list of Event
            Packets, replies and discarded bytes, in the order of the line.
        """
        self._inbox.append(data)
        return self._and_then_nothing(self._search.scan(self._inbox))

    def quiet(self) -> list[Event]:
        """Take note that the line has been quiet for some 30 ms.

        A version reply ends here, a good packet that waited for a witness is released, leftovers are discarded.

        Returns
        -------
        list of Event
        """
        events = self._search.close(self._inbox)
        return self._and_then_nothing(events + self._inbox.drop(self._inbox.end))

    @property
    def missing(self) -> int:
        """Bytes still needed to complete the next packet or reply, 1 to 18.

        A reader that asks the port for so many wakes at a packet's end, neither before nor a packet late.
        """
        return self._search.missing(self._inbox)

    @property
    def bad_checksums(self) -> int:
        """Packets and replies that were due, began rightly and had a wrong sum."""
        return self._inbox.bad_checksums

    @property
    def discarded_bytes(self) -> int:
        """Bytes that belonged to no packet and no reply."""
        return self._inbox.discarded_bytes

    def _expect(self, search: _Search) -> None:
        self._inbox.scan = self._inbox.end
        self._search = search

    def _and_then_nothing(self, events: list[Event]) -> list[Event]:
        if not self._search.done:
            return events
        self._search = _NothingSearch()
        return events + self._search.scan(self._inbox)


# ----------------------------------------------------------------------------------------------------- the unit's side


class CommandDecoder:
    """The unit's side: bytes from the host in, commands out."""

    def __init__(self) -> None:
        self._wants_argument = False

    def feed(self, data: bytes) -> list[Command]:
        """Take bytes from the line.

        Parameters
        ----------
        data : bytes
            Any number of bytes; the argument of `z` may come in a later feed than its letter.

        Returns
        -------
        list of Command
        """
        commands: list[Command] = []
        for byte in data:
            if self._wants_argument:
                self._wants_argument = False
                commands.append(ZeroRateSensors(byte))
            elif byte == ZERO_LETTER[0]:
                self._wants_argument = True
            else:
                commands.append(COMMAND_OF_BYTE.get(byte) or UnknownCommand(byte))
        return commands
