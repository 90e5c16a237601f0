"""Both ends of the line of a 440, 380 or 381: bytes in, frozen events out.

Every frame names its type, so a decoder needs no expectation: replies stand between the packets of a stream.
A frame may end in 0x55, so that three of them follow each other, and the true preamble begins with the second.
"""

from collections.abc import Callable
from functools import partial

from imutui.instrument.frame_search import Discarded, EventT, FrameDecoder, Rest, SumFrames
from imutui.instrument.uut.frames import (
    CRC_BYTES,
    FIXED_LENGTHS,
    HEADER_BYTES,
    OVERHEAD_BYTES,
    PREAMBLE,
    Frame,
    crc16,
    frame_of,
)
from imutui.instrument.uut.messages import PacketS1, content_of

# "The ping may be sent without length and CRC": the text UUPK.
BARE_PING = PREAMBLE + b"PK"
_REST_OF_PING = bytes.fromhex("00 9E F4")


def frame_decoder(
    read: Callable[[Frame], EventT | Discarded | None], *, ping_at_once: bool = False
) -> FrameDecoder[EventT]:
    """Return a decoder of frames and bare pings. It holds less than 262 bytes between feeds.

    `read`: makes the event of a frame; see `frame_search.SumFrames`.
    `ping_at_once`: True if the four bytes of a bare ping are a ping as soon as they are there, as for a unit, which
      cannot wait for more. Else they are one when something other than the rest of a whole ping follows, or nothing.
    """
    return FrameDecoder(
        SumFrames(
            PREAMBLE,
            partial(_length, ping_at_once=ping_at_once),
            _is_whole,
            lambda data: read(frame_of(data)),
            least_bytes=OVERHEAD_BYTES,
            answer=BARE_PING,
        )
    )


def Decoder() -> FrameDecoder[PacketS1 | Frame]:  # noqa: N802 - stands where others have a class of their own
    """Return a decoder of the bytes from a unit."""
    return frame_decoder(content_of)


def RequestDecoder() -> FrameDecoder[Frame]:  # noqa: N802
    """Return a decoder of the bytes from a host; a bare ping comes with its fourth byte."""
    return frame_decoder(lambda frame: frame, ping_at_once=True)


def _length(held: bytearray, at: int, rest: Rest, *, ping_at_once: bool) -> int | None:
    head = bytes(held[at : at + len(BARE_PING) + len(_REST_OF_PING)])
    if head.startswith(BARE_PING):
        behind = head[len(BARE_PING) :]
        if behind == _REST_OF_PING:
            return len(head)
        return len(BARE_PING) if ping_at_once or rest or not _REST_OF_PING.startswith(behind) else None
    if len(head) < HEADER_BYTES:
        return None
    kind, payload_bytes = head[2:4], head[HEADER_BYTES - 1]
    # a length that the type never has is likelier noise, and not waited for
    return OVERHEAD_BYTES + payload_bytes if FIXED_LENGTHS.get(kind, payload_bytes) == payload_bytes else 0


def _is_whole(data: bytes) -> bool:
    crc = int.from_bytes(data[-CRC_BYTES:], "big")
    return data == BARE_PING or crc16(data[len(PREAMBLE) : -CRC_BYTES]) == crc
