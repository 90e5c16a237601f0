"""The host side of an IMU400CD: what the session asks for, said in Crossbow's letters."""

from collections.abc import Callable, Sequence

from imutui.instrument.counter_spec import CounterSpec
from imutui.instrument.discarded import Discarded
from imutui.instrument.host import PATIENCE_S, DataPacket, InstrumentError, PacketStream
from imutui.instrument.identity import Identity
from imutui.instrument.imu400 import handshake, measurement_mode, zeroing
from imutui.instrument.imu400.crossbow import (
    POWER_UP_BAUD,
    TICK_S,
    AskSerialNumber,
    Decoder,
    Event,
    Mode,
    Packet,
    Ping,
    SerialNumber,
    StartStream,
    StopStream,
    encode,
)
from imutui.instrument.imu400.polling import Poller
from imutui.instrument.port import Port

# A unit comes back at the speed it had, or at that of power-up.
_QUICK_SPEEDS = (POWER_UP_BAUD,)

COUNTER = CounterSpec(TICK_S * 1e9, 0.006, -1)
""""The time counter counts down from 65535 to 0, and wraps"; "one tick is 0.79 microseconds": known to 0.6 %."""


class Packets:
    """Packets of a stream in scaled mode; see `host.PacketStream`."""

    def __init__(self) -> None:
        self._decoder = Decoder()
        self._decoder.expect_packets(Mode.SCALED, streaming=True)
        self.answers = 0

    def allow_reply(self, reply: SerialNumber) -> None:
        """Take note that this reply may stand between packets."""
        self._decoder.allow_reply(reply)

    def feed(self, data: bytes) -> Sequence[Packet | Discarded]:
        """Take bytes from the line."""
        return self._packets(self._decoder.feed(data))

    def pause(self) -> Sequence[Packet | Discarded]:
        """Take note that the line is quiet for the moment."""
        return self._packets(self._decoder.pause())

    def quiet(self) -> Sequence[Packet | Discarded]:
        """Take note that nothing follows."""
        return self._packets(self._decoder.quiet())

    def _packets(self, events: list[Event]) -> list[Packet | Discarded]:
        for event in events:
            self.answers = self.answers + 1 if isinstance(event, SerialNumber) else 0
        return [event for event in events if isinstance(event, Packet | Discarded)]

    @property
    def missing(self) -> int:
        """Bytes still needed to complete the next packet."""
        return self._decoder.missing

    @property
    def bad_checksums(self) -> int:
        """Packets that were due and came damaged."""
        return self._decoder.bad_checksums

    @property
    def discarded_bytes(self) -> int:
        """Bytes that belonged to no packet."""
        return self._decoder.discarded_bytes


class Imu400Host:
    """See `host.Host`. Packets leave at the pace of the unit's own loop: a stream has no other rate.

    `port`: open.
    `rate_hz`: makes no difference.
    """

    as_after_power_up = "the unit measures in volts, as after power-up"
    streams_from_power_up = False

    def __init__(self, port: Port, rate_hz: float | None = None) -> None:
        del rate_hz
        self.port = port
        self.counter = COUNTER
        self.stream_hz = 0.0

    def find(self) -> Identity:
        """Find the unit's speed and ask who it is."""
        handshake.find_speed(self.port, POWER_UP_BAUD)
        return handshake.identify(self.port)

    def answers(self, baud: int | None = None) -> bool:
        """Whether such a unit answers at a speed, or at any."""
        if baud is not None:
            return handshake.answers_at(self.port, baud)
        try:
            handshake.find_speed(self.port, POWER_UP_BAUD)
        except InstrumentError:
            return False
        return True

    def check_model(self, identity: Identity) -> None:
        """Refuse a unit whose ranges and packets are others."""
        handshake.check_model(self.port, identity)

    def open(
        self,
        baud: int | None,
        *,
        accept: Callable[[Identity], None] = lambda identity: None,
        thorough: bool = True,
        patience_s: float = PATIENCE_S,
    ) -> Identity:
        """Find the unit, identify it, set speed and scaled mode; it is polled afterwards."""
        speeds = handshake.SPEEDS if thorough else _QUICK_SPEEDS
        return handshake.open_dialogue(
            self.port, baud or POWER_UP_BAUD, lambda text: None, accept=accept, speeds=speeds, patience_s=patience_s
        )

    def start(self) -> None:
        """Have the unit stream."""
        self.port.write(encode(StartStream()))

    def stop(self) -> None:
        """Have it send nothing by itself."""
        handshake.stop_stream(self.port)

    def leave(self) -> str:
        """Leave the unit quiet, as it is from power-up on."""
        self.stop()
        return ""

    def packets(self) -> Packets:
        """What makes packets of the stream's bytes."""
        return Packets()

    def poller(self, giving_up: Callable[[], bool]) -> Poller:
        """What asks for packets one by one."""
        return Poller(self.port, giving_up)

    def ask_for_life(self) -> None:
        """Ping, without waiting for the answer."""
        self.port.write(encode(StopStream()) + encode(Ping()))

    def ask_amid(self, packets: PacketStream, identity: Identity) -> None:
        """Ask for the serial number: nobody says that it changes anything, as a ping may."""
        if isinstance(packets, Packets) and identity.serial_number:
            packets.allow_reply(SerialNumber(int(identity.serial_number)))
            self.port.write(encode(AskSerialNumber()))

    def may_have_forgotten(self, packet: DataPacket) -> bool:
        """Whether all six words would do as voltages."""
        return measurement_mode.may_be_volts(packet)

    def has_forgotten(self, packet: DataPacket, before: DataPacket, elapsed_s: float | None = None) -> bool:
        """Whether the unit measures in volts again."""
        del elapsed_s
        return measurement_mode.is_volts(packet, before)

    def set_up(self) -> bool:
        """Set scaled mode; whether the unit says that it is set."""
        return handshake.set_scaled(self.port)

    def zero(self, argument: int, stopping: Callable[[], bool]) -> float | None:
        """Have the rate sensors zeroed."""
        return zeroing.zero(self.port, argument, stopping)
