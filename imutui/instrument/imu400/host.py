"""The host side of an IMU400CD: what the session asks for, said in Crossbow's letters, and the unit's data."""

import time
from collections.abc import Callable, Sequence
from typing import Any

from filters.errors import InputError
from filters.imu import LOOP_HZ
from imutui.instrument import host, names
from imutui.instrument.counter_spec import CounterSpec
from imutui.instrument.counts import DataPacket
from imutui.instrument.frame_search import Discarded, FrameDecoder
from imutui.instrument.host import PATIENCE_S, Host, Identity, InstrumentError, PacketStream
from imutui.instrument.imu400 import handshake
from imutui.instrument.imu400.crossbow import (
    PACKET_BYTES,
    POWER_UP_BAUD,
    TICK_S,
    Command,
    Mode,
    Packet,
    Reply,
    SerialNumber,
    ZeroRateSensors,
    encode,
)
from imutui.instrument.imu400.decoder import Crossbow, packet_decoder, reply_decoder
from imutui.instrument.imu400.scaling import Scaling
from imutui.instrument.instrument import Instrument
from imutui.instrument.port import Port

# A unit comes back at the speed it had, or at that of power-up.
_QUICK_SPEEDS = (POWER_UP_BAUD,)

COUNTER = CounterSpec(TICK_S * 1e9, 0.006, -1)
""""The time counter counts down from 65535 to 0, and wraps"; "one tick is 0.79 microseconds": known to 0.6 %."""

MAX_ARGUMENT = 255
_MAX_SAMPLES_PER_UNIT = 100
_MARGIN_S = 10.0


class Imu400Host(Host):
    """See `host.Host`. Packets leave at the pace of the unit's own loop: a stream has no other rate.

    `rate_hz`: makes no difference.
    """

    as_after_power_up = "the unit measures in volts, as after power-up"
    counter = COUNTER

    def __init__(self, port: Port, rate_hz: float | None = None) -> None:
        super().__init__(port)
        self._streamed: Crossbow | None = None

    def find(self) -> Identity:
        handshake.find_speed(self.port, POWER_UP_BAUD)
        return handshake.identify(self.port)

    def answers(self, baud: int | None = None) -> bool:
        if baud is not None:
            return handshake.answers_at(self.port, baud)
        try:
            handshake.find_speed(self.port, POWER_UP_BAUD)
        except InstrumentError:
            return False
        return True

    def check_model(self, identity: Identity) -> None:
        handshake.check_model(self.port, identity)

    def open(
        self,
        baud: int | None,
        *,
        accept: Callable[[Identity], None] = lambda identity: None,
        thorough: bool = True,
        patience_s: float = PATIENCE_S,
    ) -> Identity:
        speeds = handshake.SPEEDS if thorough else _QUICK_SPEEDS
        return handshake.open_dialogue(
            self.port, baud or POWER_UP_BAUD, accept=accept, speeds=speeds, patience_s=patience_s
        )

    def start(self) -> None:
        self.port.write(encode(Command.START_STREAM))

    def stop(self) -> None:
        handshake.stop_stream(self.port)

    def packets(self) -> PacketStream:
        self._streamed = Crossbow(Mode.SCALED, streaming=True)
        return FrameDecoder(self._streamed)

    def poller(self, giving_up: Callable[[], bool]) -> host.Poller:
        return Poller(self.port, giving_up)

    def ask_for_life(self) -> None:
        self.port.write(encode(Command.STOP_STREAM) + encode(Command.PING))

    def ask_amid(self, identity: Identity) -> None:
        """Ask for the serial number: nobody says that it changes anything, as a ping may."""
        if self._streamed is not None and identity.serial_number:
            self._streamed.reply = encode(SerialNumber(int(identity.serial_number)))
            self.port.write(encode(Command.SERIAL_NUMBER))

    def may_have_forgotten(self, packet: DataPacket) -> bool:
        return may_be_volts(packet)

    def has_forgotten(self, packet: DataPacket, before: DataPacket, elapsed_s: float | None = None) -> bool:
        return is_volts(packet, before)

    def set_up(self) -> bool:
        return handshake.set_scaled(self.port)

    def zero(self, argument: int, stopping: Callable[[], bool]) -> float | None:
        """Have the unit, held still, average its rate sensors and subtract the mean from then on.

        It answers `Z` when that is done and sends nothing meanwhile; one that has not in time may be at it still.
        """
        self.stop()
        command = ZeroRateSensors(argument)
        decoder = reply_decoder(command)
        self.port.write(encode(command))
        began = time.monotonic()
        while not stopping() and time.monotonic() - began < zeroing_patience_s(argument):
            data = self.port.read(decoder.missing)
            if Reply.RATES_ZEROED in (decoder.feed(data) if data else decoder.quiet()):
                return time.monotonic() - began
        return None


class Poller(host.Poller):
    """See `host.Poller`: a late unit is told once more to measure in scaled mode, which it does already."""

    _LETTER = encode(Reply.SCALED_MODE)

    def __init__(self, port: Port, giving_up: Callable[[], bool]) -> None:
        decoder = packet_decoder(Mode.SCALED, streaming=False)
        # the letter by which it says so is no packet, hence discarded
        request = encode(Command.GET_PACKET), Packet
        super().__init__(port, giving_up, decoder, request, (encode(Command.SCALED_MODE), Discarded))
        self._letters = 0

    @property
    def discarded_bytes(self) -> int:
        return super().discarded_bytes - self._letters

    def _stray(self, data: bytes) -> bytes:
        return data.strip(self._LETTER)

    def _count_checks(self, events: Sequence[Any]) -> int:
        """How often the unit said that its mode is set, where it said nothing else at that."""
        said = [event.data for event in events if isinstance(event, Discarded)]
        count = sum(len(data) for data in said if not data.strip(self._LETTER))
        self._letters += count
        return count


def check_zeroing(argument: int) -> None:
    """Refuse what cannot be sent.

    Raises InputError with the argument and what it may be.
    """
    if not 0 <= argument <= MAX_ARGUMENT:
        raise InputError(
            f"`argument` is {argument}; it travels as one byte, 0 to {MAX_ARGUMENT}; 0 erases the stored zero"
        )


def zeroing_patience_s(argument: int) -> float:
    """How long to wait for the end of a zeroing, s: the longest that any document allows, and some more.

    Documents dispute the average that the argument asks for: ten or a hundred samples for each unit of it.
    """
    return _MARGIN_S + 1.1 * _MAX_SAMPLES_PER_UNIT * argument / LOOP_HZ


# ------------------------------------------------------------------------------------------------------------- volts

# Packets in volts and in scaled units have the same length and header. What tells them is that voltage words are of 12
# bits, and that both words say the same: 2.5 V stands for zero, 0 and 5 V for the ends of the scaled range.
_MOST_VOLTS = 4095
_VOLTS_AT_ZERO = 2048
_SCALED_A_VOLT_COUNT = 16
# an eighth of the range within a packet's time; and no word of scaled packets in a row goes so far in three channels
_MOVED = 256
_JUMPED = 512
_JUMPS = 3


def may_be_volts(packet: DataPacket) -> bool:
    """Whether all six words would do as voltages."""
    words = _words(packet)
    return min(words) >= 0 and max(words) <= _MOST_VOLTS


def is_volts(packet: DataPacket, scaled: DataPacket) -> bool:
    """Whether a packet says in volts what one of about the same moment said in scaled units."""
    if not may_be_volts(packet):
        return False
    now, then = _words(packet), _words(scaled)
    expected = [_VOLTS_AT_ZERO + word // _SCALED_A_VOLT_COUNT for word in then]
    agrees = all(abs(word - volts) <= _MOVED for word, volts in zip(now, expected, strict=True))
    jumps = sum(abs(word - old) > _JUMPED for word, old in zip(now, then, strict=True))
    return agrees and jumps >= _JUMPS


def _words(packet: DataPacket) -> tuple[int, ...]:
    return (*packet.rates, *packet.accels)


IMU400CD = Instrument(
    name=names.IMU400CD,
    models=("IMU400",),
    model="IMU400CD-200",
    is_one_model=True,
    power_up_bauds=(POWER_UP_BAUD,),
    packet_bytes=PACKET_BYTES,
    rates_hz=(133.0,),
    low_pass_loop_hz=LOOP_HZ,
    accel_sign=-1,
    mode="scaled mode",
    mode_words="scaled: deg/s and g from the unit; voltage mode is not used",
    counter=COUNTER,
    rate_range_dps=200.0,
    accel_range_g=4.0,
    scaling=Scaling,
    zeroes_rates=True,
    check_zeroing=check_zeroing,
    zeroing_patience_s=zeroing_patience_s,
    host=Imu400Host,
)
"""Crossbow's IMU400CD."""
