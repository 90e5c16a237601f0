"""What the decoder looks for in the bytes it holds: one reply of a Crossbow unit, or nothing at all.

`packet_search` looks for data packets.
"""

from typing import Protocol

from imutui.instrument.imu400.inbox import Inbox
from imutui.instrument.imu400.messages import (
    HEADER,
    PACKET_BYTES,
    REPLY_LETTERS,
    SERIAL_BYTES,
    SERIAL_WORD,
    Event,
    Reply,
    SerialNumber,
    Version,
    checksum,
)

# The manual says "ASCII string"; units send 0xFF, text, checksum, and drivers read at most 32 bytes.
_VERSION_BYTES = 32


class Search(Protocol):
    """What the decoder looks for in the inbox."""

    def scan(self, inbox: Inbox) -> list[Event]:
        """Return what can be told from the bytes so far, and leave the rest."""
        ...

    def close(self, inbox: Inbox) -> list[Event]:
        """Return what can be told knowing that the line is quiet."""
        ...

    def missing(self, inbox: Inbox) -> int:
        """Bytes needed before `scan` can tell more."""
        ...

    @property
    def done(self) -> bool:
        """Whether nothing more is expected."""
        ...


class NothingSearch:
    """Nothing is expected: whatever comes is discarded."""

    done = False

    def scan(self, inbox: Inbox) -> list[Event]:
        """Nothing is looked for: all bytes are discarded, and told as such."""
        return inbox.drop(inbox.end)

    def close(self, inbox: Inbox) -> list[Event]:
        """Nothing is looked for: all bytes are discarded, and told as such."""
        return self.scan(inbox)

    def missing(self, inbox: Inbox) -> int:
        """One: whatever comes is discarded at once."""
        return 1


class LetterSearch:
    """A reply of one letter. Letters are payload bytes too, hence only looked for when asked for."""

    def __init__(self, reply: Reply) -> None:
        self._reply = reply
        self._letter = REPLY_LETTERS[reply][0]
        self.done = False

    def scan(self, inbox: Inbox) -> list[Event]:
        """The reply, once its letter has come; all before it is noise."""
        if not inbox.seek(self._letter):
            return inbox.drop(inbox.end)
        self.done = True
        events = inbox.drop(inbox.scan)
        inbox.take(1)
        return [*events, self._reply]

    def close(self, inbox: Inbox) -> list[Event]:
        """Nothing: a letter is whole as soon as it is there."""
        return []

    def missing(self, inbox: Inbox) -> int:
        """One byte: the reply is a letter alone."""
        return 1


class SerialNumberSearch:
    """The serial number: header, 32-bit word, checksum."""

    def __init__(self, due: int) -> None:
        self._due = due
        self.done = False

    def scan(self, inbox: Inbox) -> list[Event]:
        """The serial number, once a header and five bytes with the right sum have come."""
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

    def close(self, inbox: Inbox) -> list[Event]:
        """Nothing; from here on the reply is due, and one with a wrong sum counts as damaged."""
        self._due = inbox.end
        return []

    def missing(self, inbox: Inbox) -> int:
        """Bytes up to the end of the reply."""
        return SERIAL_BYTES - inbox.unjudged


class VersionSearch:
    """The version text, whose length nobody documents: it ends when the line falls quiet, or with its 32nd byte."""

    done = False

    def scan(self, inbox: Inbox) -> list[Event]:
        """The version, once so much has come that it must be whole."""
        events: list[Event] = []
        while not self.done:
            inbox.seek(HEADER, within=_VERSION_BYTES)
            if inbox.unjudged < _VERSION_BYTES:
                break
            events += self._read(inbox, _VERSION_BYTES)
        return events

    def close(self, inbox: Inbox) -> list[Event]:
        """The version from what there is: its length is known by the quiet after it only."""
        return self._read(inbox, inbox.unjudged)

    def missing(self, inbox: Inbox) -> int:
        """Bytes up to the longest reply, at most a packet."""
        return min(PACKET_BYTES, _VERSION_BYTES - inbox.unjudged)

    def _read(self, inbox: Inbox, length: int) -> list[Event]:
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
