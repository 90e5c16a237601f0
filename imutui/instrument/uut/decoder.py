"""Both ends of the line of a 440, 380 or 381: bytes in, frozen events out.

Unlike the IMU400's, every frame says what it is, so that nothing has to be expected: replies come between the packets
of a stream, and are told apart by their type. A frame may end in 0x55, so that three of them follow each other, and the
true preamble begins with the second.
"""

from collections.abc import Callable

from imutui.instrument.frame_search import Discarded, EventT_co, FrameDecoder, FrameSearch, Inbox
from imutui.instrument.uut.frames import FORM, PREAMBLE, Frame, frame_of
from imutui.instrument.uut.messages import Measurement, Reply, Request, read_reply, read_request

# "The ping may be sent without length and CRC": the text UUPK.
BARE_PING = PREAMBLE + b"PK"
_REST_OF_PING = bytes.fromhex("00 9E F4")


class UutSearch(FrameSearch[EventT_co]):
    """Frames, and bare pings.

    `read`: what a frame says; see `FrameSearch`.
    `ping_at_once`: whether the four bytes of a bare ping are a ping as soon as they are there, as for a unit, which
      can't wait for more. Else they are one when something other than the rest of a whole ping follows, or nothing.
    """

    def __init__(self, read: Callable[[Frame], EventT_co | Discarded | None], *, ping_at_once: bool = False) -> None:
        super().__init__(FORM, lambda data: read(frame_of(data)))
        self._ping_at_once = ping_at_once

    def _frames_from(self, inbox: Inbox, at: int, *, paused: bool) -> list[tuple[int, int]] | None:
        bare = at + len(BARE_PING)
        if inbox.peek(at, len(BARE_PING)) != BARE_PING:
            return super()._frames_from(inbox, at, paused=paused)
        rest = inbox.peek(bare, len(_REST_OF_PING))
        if rest == _REST_OF_PING:
            return [(at, bare + len(rest))]
        if self._ping_at_once or paused or not _REST_OF_PING.startswith(rest):
            return [(at, bare)]
        return None

    def _accept(self, inbox: Inbox, start: int, end: int) -> list[EventT_co | Discarded]:
        self.answers += inbox.peek(start, len(BARE_PING)) == BARE_PING
        return super()._accept(inbox, start, end)


class Decoder(FrameDecoder[Measurement | Reply]):
    """The host's side: bytes from the unit in, events out. Less than 262 bytes are held between feeds."""

    def __init__(self) -> None:
        super().__init__(UutSearch(read_reply))


class RequestDecoder:
    """The unit's side: bytes from the host in, requests out. Frames with a wrong CRC are ignored, as noise is."""

    def __init__(self) -> None:
        self._decoder: FrameDecoder[Request] = FrameDecoder(UutSearch(read_request, ping_at_once=True))

    def feed(self, data: bytes) -> list[Request]:
        """Take bytes from the line, any number, cut anywhere; a bare ping comes with its fourth byte."""
        return [found for found in self._decoder.feed(data) if not isinstance(found, Discarded)]

    def quiet(self) -> list[Request]:
        """Give up the beginning of a frame, whose rest has not come in time; what was whole behind it comes out."""
        return [found for found in self._decoder.quiet() if not isinstance(found, Discarded)]

    @property
    def has_begun(self) -> bool:
        """Whether the beginning of a frame is there."""
        return self._decoder.holds
