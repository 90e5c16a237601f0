"""The host's side of the Crossbow protocol: packets and replies in a stream of bytes.

Neither header nor sum makes a packet sure, and letters are payload bytes too: so each decoder finds what was asked for
and nothing else.
"""

from imutui.instrument.counter_spec import SPAN
from imutui.instrument.frame_search import FrameDecoder, Judged, Rest, Rule, SumFrames, noise
from imutui.instrument.imu400.crossbow import (
    HEADER,
    LETTER_REPLIES,
    PACKET_BYTES,
    SERIAL_BYTES,
    TICK_S,
    Command,
    Mode,
    Packet,
    checksum,
    is_whole,
    packet_of,
    serial_number_in,
)

# "Up to 133 Hz", 7.5 ms: the period assumed until packets back to back show another.
NOMINAL_PERIOD_S = 7.5e-3

# A seventh period would wrap. A step of two or three is usual where the line is slower than the unit's loop.
_MOST_PERIODS = 6
_STEP_TOLERANCE = 0.02

# The manual says "ASCII string"; units send 0xFF, text, checksum, of 26 bytes. A virtual unit's text may be longer.
_VERSION_BYTES = 255


def packet_decoder(mode: Mode, *, streaming: bool) -> FrameDecoder[Packet]:
    """Return a decoder of data packets. It holds less than 36 bytes between feeds.

    `mode`: the unit's measurement mode.
    `streaming`: True if packets come by themselves, back to back or at the loop's rate; False if one comes for each
      `Command.GET_PACKET`.
    """
    return FrameDecoder(Crossbow(mode, streaming=streaming), due=not streaming)


def reply_decoder(command: bytes) -> FrameDecoder[str]:
    """Return a decoder of the reply to a command, as text; it discards the bytes before and behind the reply.

    `command`: one that is answered by a letter, a serial number or a version.
    """
    rule: Rule[str]
    if command == Command.SERIAL_NUMBER:
        rule = SumFrames(HEADER, lambda *_: SERIAL_BYTES, is_whole, serial_number_in, least_bytes=SERIAL_BYTES)
    elif command == Command.VERSION:
        rule = _VersionText()
    else:
        letter = LETTER_REPLIES[Command(command[:1])].encode()
        rule = SumFrames(letter, lambda *_: 1, lambda frame: True, bytes.decode, least_bytes=1)
    return FrameDecoder(rule, due=True)


class Crossbow:
    """The rule for data packets.

    The header 0xFF is a common byte, and one wrong frame in 256 has a right sum. So a frame of a stream counts if its
    counter follows the last packet's by one to six periods, or if another whole frame, or the reply that was asked for,
    stands right behind it. Where the line rests behind a frame with a right sum, it counts too.

    A polled packet comes alone on a quiet line: its sum is enough.
    """

    def __init__(self, mode: Mode, *, streaming: bool) -> None:
        self._mode, self._streaming = mode, streaming
        self._last_ticks: int | None = None
        self._period_ticks = NOMINAL_PERIOD_S / TICK_S
        self.answers = 0
        self.reply = b""
        """Serial number as it may stand between packets; empty unless the unit was asked for it."""

    def judge(self, held: bytearray, at: int, rest: Rest) -> Judged | None:
        """Judge as `Rule.judge` does."""
        if not held.startswith(HEADER, at):
            return noise(held, at, HEADER)
        # a unit replies between packets: a packet that began before its reply does not go on
        reply_at = held.find(self.reply, at, at + PACKET_BYTES + SERIAL_BYTES - 1) if self.reply else -1
        if reply_at >= 0:
            self.answers += reply_at == at
            return Judged(reply_at - at) if reply_at > at else Judged(SERIAL_BYTES, True)
        end = at + PACKET_BYTES
        if end > len(held):
            return None
        frame = bytes(held[at:end])
        if not is_whole(frame):
            return noise(held, at, HEADER, skip=1, spoiled=PACKET_BYTES)
        ticks = _ticks(frame)
        if self._streaming and not self._follows(self._last_ticks, ticks):
            is_sure = self._is_sure(ticks, bytes(held[end : end + PACKET_BYTES]), rest)
            if not is_sure:
                return None if is_sure is None else noise(held, at, HEADER, skip=1)
        self._last_ticks, self.answers = ticks, 0
        return Judged(PACKET_BYTES, True, packet_of(self._mode, frame))

    def missing(self, held: bytearray) -> int:
        """Return the bytes up to the end of the frame that has begun."""
        return PACKET_BYTES - len(held) % PACKET_BYTES

    def _is_sure(self, ticks: int, behind: bytes, rest: Rest) -> bool | None:
        """Return True if the bytes behind a frame make it a packet, False if they do not, None if more must come."""
        if self.reply and behind.startswith(self.reply):
            return True
        if len(behind) < PACKET_BYTES and behind[:1] in (b"", HEADER):
            return True if rest else None
        if not behind.startswith(HEADER) or not is_whole(behind):
            return False
        self._learn(ticks, _ticks(behind))
        return True

    def _follows(self, earlier: int | None, later: int) -> bool:
        """Return True if the counter stepped down by one to six periods, within 2 %."""
        if earlier is None:
            return False
        step = (earlier - later) % SPAN
        periods = round(step / self._period_ticks)
        off = abs(step - periods * self._period_ticks)
        return 0 < periods <= _MOST_PERIODS and off <= _STEP_TOLERANCE * periods * self._period_ticks

    def _learn(self, earlier: int, later: int) -> None:
        """Learn the period from two packets back to back, unless the known one explains them.

        On a line that takes two and a half periods a packet steps are of two and of three: either alone would mislead.
        """
        if earlier != later and not self._follows(earlier, later):
            self._period_ticks = (earlier - later) % SPAN


def _ticks(frame: bytes) -> int:
    return int.from_bytes(frame[15:17], "big")


class _VersionText:
    """The rule for the version text. Its length is not documented: it ends when the line rests, or with 255 bytes."""

    answers = 0

    def judge(self, held: bytearray, at: int, rest: Rest) -> Judged | None:
        begin = held.find(HEADER, at, at + _VERSION_BYTES)
        if begin > at:
            return Judged(begin - at)
        reply = bytes(held[at : at + _VERSION_BYTES])
        if len(reply) < _VERSION_BYTES and not rest:
            return None
        text = _version_text(reply)
        if text is None:
            return Judged(len(reply), spoiled=len(reply) if begin == at else 0)
        return Judged(len(reply), True, text)

    def missing(self, held: bytearray) -> int:
        return min(PACKET_BYTES, _VERSION_BYTES - len(held))


def _version_text(reply: bytes) -> str | None:
    """Return the text of a version reply, perhaps behind noise; None if there is none."""
    for position in range(len(reply)):
        body = reply[position + 1 : -1]
        if reply.startswith(HEADER, position) and body and _is_text(body) and checksum(body) == reply[-1]:
            return body.decode("ascii")
    body = reply.lstrip(HEADER).strip(b"\0\r\n ")
    return body.decode("ascii") if body and _is_text(body) else None


def _is_text(body: bytes) -> bool:
    return all(0x20 <= byte < 0x7F or byte in b"\t\r\n" for byte in body)
