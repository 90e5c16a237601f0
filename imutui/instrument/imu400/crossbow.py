"""The Crossbow "DMU" serial protocol of the IMU300CC, IMU400CC and IMU400CD: bytes in, frozen events out.

The module does no input or output, reads no clock, and raises nothing for noise: bytes that mean nothing become a
`Discarded` event and a counter. It knows both ends of the line. `Decoder` is the host's side (packets and replies),
`CommandDecoder` the unit's side, and `encode` writes anything either of them reads; messages stand in `messages`, units
in `scaling`, how packets and replies are found in `packet_search` and `reply_search`. All names that others need can be
had from here.
"""

from imutui.instrument.imu400.inbox import Inbox
from imutui.instrument.imu400.messages import (
    COMMAND_OF_BYTE,
    COUNTER_SPAN,
    HEADER,
    PACKET_BYTES,
    POWER_UP_BAUD,
    TICK_S,
    ZERO_LETTER,
    AskSerialNumber,
    AskVersion,
    BaudReady,
    BaudSet,
    Command,
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
)
from imutui.instrument.imu400.packet_search import NOMINAL_PERIOD_S, PacketSearch
from imutui.instrument.imu400.reply_search import LetterSearch, NothingSearch, Search, SerialNumberSearch, VersionSearch
from imutui.instrument.imu400.scaling import Scaling

__all__ = [
    "COUNTER_SPAN",
    "HEADER",
    "NOMINAL_PERIOD_S",
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


# ----------------------------------------------------------------------------------------------------- the host's side


class Decoder:
    """The host's side: bytes from the unit in, events out.

    What comes out does not depend on how the bytes are cut into feeds, only when. At most about 200 bytes are held
    between feeds. The decoder starts expecting nothing, so that everything is discarded.
    """

    def __init__(self) -> None:
        self._inbox = Inbox()
        self._search: Search = NothingSearch()

    def expect_packets(self, mode: Mode, *, streaming: bool) -> None:
        """Look for data packets from here on, knowing nothing of earlier ones.

        Bytes still held belong to what was expected before: they are discarded with the next feed.

        `mode`: what the unit was told to measure.
        `streaming`: whether packets come by themselves, back to back or at the loop's rate, or one for each
          `GetPacket`.
        """
        self._expect(PacketSearch(mode, streaming=streaming, due=self._inbox.end))

    def allow_reply(self, reply: SerialNumber) -> None:
        """Take note that this reply may stand between the packets that are looked for."""
        if isinstance(self._search, PacketSearch):
            self._search.reply = reply

    def expect_reply(self, command: Command) -> None:
        """Look for the reply to `command` from here on, and after it for nothing.

        `command`: one that is answered by a letter, a serial number or a version.
        Raises ValueError if the unit answers `command` with packets or not at all.
        """
        match command:
            case AskSerialNumber():
                self._expect(SerialNumberSearch(self._inbox.end))
            case AskVersion():
                self._expect(VersionSearch())
            case Ping():
                self._expect(LetterSearch(Pong()))
            case SetMode(mode):
                self._expect(LetterSearch(ModeSet(mode)))
            case ZeroRateSensors():
                self._expect(LetterSearch(RatesZeroed()))
            case RequestBaud():
                self._expect(LetterSearch(BaudReady()))
            case MeasureBaud():
                self._expect(LetterSearch(BaudSet()))
            case _:
                raise ValueError(f"`command` must be one that is answered by a reply, not {command}")

    def feed(self, data: bytes) -> list[Event]:
        """Take bytes from the line.

        `data`: any number of bytes, cut anywhere.
        Returns packets, replies and discarded bytes, in the order of the line.
        """
        self._inbox.append(data)
        return self._and_then_nothing(self._search.scan(self._inbox))

    def quiet(self) -> list[Event]:
        """Take note that the line has been quiet for some 30 ms.

        A version reply ends here, a good packet that waited for a witness is released, leftovers are discarded.
        """
        events = self._search.close(self._inbox)
        return self._and_then_nothing(events + self._inbox.drop(self._inbox.end))

    def pause(self) -> list[Event]:
        """Take note that the line is quiet for the moment, while a stream is expected to go on.

        A good packet that waited for a witness is released. The beginning of a packet is kept: a line that was held up
        brings the rest later, and if it brings something else, the sum tells.
        """
        return self._search.release(self._inbox) if isinstance(self._search, PacketSearch) else []

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

    def _expect(self, search: Search) -> None:
        self._inbox.scan = self._inbox.end
        self._search = search

    def _and_then_nothing(self, events: list[Event]) -> list[Event]:
        if not self._search.done:
            return events
        self._search = NothingSearch()
        return events + self._search.scan(self._inbox)


# ----------------------------------------------------------------------------------------------------- the unit's side


class CommandDecoder:
    """The unit's side: bytes from the host in, commands out."""

    def __init__(self) -> None:
        self._wants_argument = False

    def feed(self, data: bytes) -> list[Command]:
        """Take bytes from the line.

        `data`: any number of bytes; the argument of `z` may come in a later feed than its letter.
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
