"""Both ends of the line of a 440, 380 or 381: bytes in, frozen events out.

Unlike the IMU400's, every frame says what it is, so that nothing has to be expected: replies come between the packets
of a stream, and are told apart by their type.
"""

from imutui.instrument.discarded import Discarded
from imutui.instrument.uut.frame_search import FrameSearch
from imutui.instrument.uut.frames import Frame
from imutui.instrument.uut.messages import Event, Request
from imutui.instrument.uut.payloads import read_reply, read_request


class Decoder:
    """The host's side: bytes from the unit in, events out.

    What comes out does not depend on how the bytes are cut into feeds, only when. Less than 262 bytes are held between
    feeds.
    """

    def __init__(self) -> None:
        self._search = FrameSearch()

    def feed(self, data: bytes) -> list[Event]:
        """Take bytes from the line.

        `data`: any number of bytes, cut anywhere.
        Returns measurements, replies and discarded bytes, in the order of the line.
        """
        return _events(self._search.feed(data))

    def quiet(self) -> list[Event]:
        """Take note that the line has been quiet for some 30 ms: what has begun and was not finished is discarded."""
        return _events(self._search.quiet())

    def pause(self) -> list[Event]:
        """Take note that the line is quiet for the moment, while a stream is expected to go on.

        The beginning of a frame is kept, unless there are whole ones within it, which noise seemed to cover.
        """
        return _events(self._search.pause())

    @property
    def missing(self) -> int:
        """Bytes still needed to complete the next frame, 1 to 262.

        A reader that asks the port for so many wakes at a frame's end. While none has begun it is taken to be as long
        as the last one.
        """
        return self._search.missing

    @property
    def bad_checksums(self) -> int:
        """Frames that were due, right behind another one, and had a wrong CRC."""
        return self._search.bad_checksums

    @property
    def discarded_bytes(self) -> int:
        """Bytes that belonged to no frame."""
        return self._search.discarded_bytes


class RequestDecoder:
    """The unit's side: bytes from the host in, requests out. Frames with a wrong CRC are ignored, as noise is."""

    def __init__(self) -> None:
        self._search = FrameSearch(ping_at_once=True)

    def feed(self, data: bytes) -> list[Request]:
        """Take bytes from the line, any number, cut anywhere.

        Returns a bare ping comes with its fourth byte.
        """
        return [read_request(found) for found in self._search.feed(data) if isinstance(found, Frame)]

    def quiet(self) -> list[Request]:
        """Give up the beginning of a frame, whose rest has not come in time.

        Returns what was whole behind that beginning.
        """
        return [read_request(found) for found in self._search.quiet() if isinstance(found, Frame)]

    @property
    def has_begun(self) -> bool:
        """Whether the beginning of a frame is there."""
        return self._search.holds


def _events(found: list[Frame | Discarded]) -> list[Event]:
    return [read_reply(each) if isinstance(each, Frame) else each for each in found]
