"""The driver of the IMU400CD: its data, and the dialogue in Crossbow's letters.

The dialogue is right under every reading of `R`: `P`, quiet, flush, `R`, expect `H`, `S`, `v`, then always the mode
again, since a ping may or may not reset it. A letter counts as a reply only where it stands alone: it may be a byte of
something else.
"""

import re
import time
from collections.abc import Callable, Sequence

from filters.errors import InputError
from filters.imu import LOOP_HZ
from imutui.instrument import names
from imutui.instrument.counter_spec import CounterSpec
from imutui.instrument.counts import DataPacket
from imutui.instrument.driver import (
    REPLY_S,
    Driver,
    Identity,
    InstrumentError,
    PacketStream,
    Poller,
    exchange,
    origin_of,
)
from imutui.instrument.frame_search import Discarded, FrameDecoder
from imutui.instrument.imu400.crossbow import (
    LETTER_REPLIES,
    PACKET_BYTES,
    POWER_UP_BAUD,
    TICK_S,
    Command,
    Mode,
    Packet,
    serial_number_frame,
    zero_rates,
)
from imutui.instrument.imu400.decoder import Crossbow, packet_decoder, reply_decoder
from imutui.instrument.imu400.scaling import SCALED_A_VOLTAGE_COUNT, VOLTAGE_AT_REST, VOLTAGE_LIMITS, scaling
from imutui.instrument.port import Port

COUNTER = CounterSpec(TICK_S * 1e9, 0.006, -1)
""""The time counter counts down from 65535 to 0, and wraps"; "one tick is 0.79 microseconds": known to 0.6 %."""

SPEEDS = (POWER_UP_BAUD, 57600, 115200, 19200, 9600)
_OTHERS = re.compile(
    r"IMU[ -]?(300|400C[ABCE]|440|5\d\d|6\d\d)\S*|AHRS\S*|\bVG\S*|\bRGA\S*|\bNAV\S*|DMU\S*|HDX\S*|\bMTI\S*", re.I
)

_PONG_S = 0.2
_STOPS_WITHIN_S = 0.25
_TRIES = 3
_PONG = LETTER_REPLIES[Command.PING].encode()

_MOST_ARGUMENT = 255
_MOST_SAMPLES_PER_UNIT = 100
_ZEROING_MARGIN_S = 10.0


class Imu400cd(Driver):
    """Crossbow's IMU400CD. Its packets leave at the pace of the unit's own loop: a stream has no other rate."""

    name = names.IMU400CD
    models = ("IMU400",)
    model = "IMU400CD-200"
    is_one_model = True
    power_up_bauds = (POWER_UP_BAUD,)
    packet_bytes = PACKET_BYTES
    rates_hz = (133.0,)
    low_pass_loop_hz = LOOP_HZ
    accel_sign = -1
    mode = "scaled mode"
    mode_words = "scaled: deg/s and g from the unit; voltage mode is not used"
    counter = COUNTER
    rate_range_dps = 200.0
    accel_range_g = 4.0
    scaling = staticmethod(scaling)
    zeroes_rates = True
    as_after_power_up = "the unit measures in volts, as after power-up"
    _stop_command = Command.STOP_STREAM

    def __init__(self, port: Port, rate_hz: float | None = None) -> None:
        super().__init__(port, rate_hz)
        self._streamed: Crossbow | None = None

    @classmethod
    def check_zeroing(cls, argument: int) -> None:
        if not 0 <= argument <= _MOST_ARGUMENT:
            raise InputError(
                f"`argument` is {argument}; it travels as one byte, 0 to {_MOST_ARGUMENT}; 0 erases the stored zero"
            )

    @staticmethod
    def zeroing_patience_s(argument: int) -> float:
        # documents dispute whether the argument counts ten samples or a hundred
        return _ZEROING_MARGIN_S + 1.1 * _MOST_SAMPLES_PER_UNIT * argument / LOOP_HZ

    # ----------------------------------------------------------------------------------------- finding and setting up

    def find(self) -> Identity:
        self.find_speed(POWER_UP_BAUD)
        return self.identify()

    def answers(self, baud: int | None = None) -> bool:
        if baud is not None:
            self.port.set_baud(baud)
            # one that streams stops within a packet: whatever goes on sending is another
            self.stop(_STOPS_WITHIN_S)
            return self._ping()[0]
        try:
            self.find_speed(POWER_UP_BAUD)
        except InstrumentError:
            return False
        return True

    def open(
        self,
        baud: int | None,
        *,
        accept: Callable[[Identity], None] = lambda identity: None,
        thorough: bool = True,
    ) -> Identity:
        baud = baud or POWER_UP_BAUD
        # one that was lost has the speed it had, or that of power-up
        self.find_speed(baud, SPEEDS if thorough else (POWER_UP_BAUD,))
        identity = self.identify()
        accept(identity)
        self.check_model(identity)
        if self.port.baud != baud:
            self._move_speed(baud)
        if not self.set_up():
            raise InstrumentError(
                f"{self.port.name}: the unit answers a ping but not the command for scaled mode, so its packets could"
                " not be trusted. Power it off and on, then connect again."
            )
        return identity

    def find_speed(self, wanted: int, speeds: Sequence[int] = SPEEDS) -> None:
        """Stop the unit and find the speed at which it answers a ping; the port is left at it.

        `wanted`: tried after the port's own speed.
        `speeds`: tried then.
        Raises InstrumentError if nothing answers at any speed, or not as a Crossbow unit does.
        """
        heard, first = b"", self.port.baud
        for speed in dict.fromkeys((first, wanted, *speeds)):
            self.port.set_baud(speed)
            heard += self.stop()
            for _ in range(_TRIES if speed == first else 1):
                has_answered, noise = self._ping()
                heard += noise
                if has_answered:
                    return
                if noise:
                    heard += self.stop()
        raise InstrumentError(_no_answer(self.port, heard))

    def identify(self) -> Identity:
        """Ask a unit that is polled, on a quiet line at its own speed, for its serial number and version."""
        number, version = self._ask(Command.SERIAL_NUMBER), self._ask(Command.VERSION)
        # a unit that answers only one of them is asked once more: a byte may have been lost
        if version is not None and number is None:
            number = self._ask(Command.SERIAL_NUMBER)
        if number is not None and version is None:
            version = self._ask(Command.VERSION)
        return Identity(number or "", *origin_of(version or ""))

    def check_model(self, identity: Identity) -> None:
        version = identity.version.upper().replace(" ", "")
        other = re.search(r"IMU400CD-(?!200)\d", version) if "IMU400CD" in version else _OTHERS.search(identity.version)
        if other:
            raise InstrumentError(
                f'{self.port.name}: the unit says it is "{identity.version}", not an IMU400CD-200. Its ranges and'
                " packets differ, so its readings would be wrong. Connect the IMU400CD, or name its port."
            )

    def set_up(self) -> bool:
        return any(self._ask(Command.SCALED_MODE) is not None for _ in range(_TRIES))

    def _move_speed(self, baud: int) -> None:
        found = self.port.baud
        if self._ask(Command.REQUEST_BAUD) is not None:
            self.port.set_baud(baud)
            if self._ask(Command.MEASURE_BAUD) is not None:
                return
        raise InstrumentError(
            f"{self.port.name}: the unit answers at {found} baud and will not go to {baud}."
            f" Connect with --baud {found}, or power it off and on."
        )

    def _ask(self, command: Command) -> str | None:
        """Send a command on a quiet line and return its reply; None if it does not come, or comes damaged twice."""
        for _ in range(2):
            found, noise = self._reply(command, REPLY_S)
            if found is not None:
                return found
            if not noise:
                break
        return None

    def _ping(self) -> tuple[bool, bytes]:
        """Send a ping; returns True if a unit answers it, and the other bytes that came."""
        pong, noise = self._reply(Command.PING, _PONG_S)
        return pong is not None, noise

    def _reply(self, command: Command, patience_s: float) -> tuple[str | None, bytes]:
        """Send a command; returns its reply, if one comes that stands alone, and the other bytes that came."""
        noise = b""

        def is_end(event: str | Discarded) -> bool:
            nonlocal noise
            if isinstance(event, str):
                return True
            noise += event.data
            return event.bad_checksum or len(noise) >= PACKET_BYTES

        found = exchange(self.port, reply_decoder(command), command, is_end, patience_s)
        if isinstance(found, str) and command in LETTER_REPLIES:
            # a unit that was pinged twice answers twice; anything else around a letter makes it noise
            noise += self.port.read(PACKET_BYTES).strip(_PONG)
            found = None if noise else found
        return (found if isinstance(found, str) else None), noise

    # -------------------------------------------------------------------------------------------------------- packets

    def start(self) -> None:
        self.port.write(Command.START_STREAM)

    def packets(self) -> PacketStream:
        self._streamed = Crossbow(Mode.SCALED, streaming=True)
        return FrameDecoder(self._streamed)

    def poller(self, giving_up: Callable[[], bool]) -> Poller:
        """Return a poller that sets a late unit's mode once more; its decoder discards the letter of the reply."""
        decoder, letter = packet_decoder(Mode.SCALED, streaming=False), LETTER_REPLIES[Command.SCALED_MODE].encode()

        def replies(event: object) -> int:
            return len(event.data) if isinstance(event, Discarded) and not event.data.strip(letter) else 0

        return Poller(self, giving_up, decoder, (Command.GET_PACKET, Packet), (Command.SCALED_MODE, replies))

    def ask_for_life(self) -> None:
        self.port.write(Command.STOP_STREAM + Command.PING)

    def ask_amid(self, identity: Identity) -> None:
        """Ask for the serial number: by no document does this change anything, as a ping may."""
        if self._streamed is not None and identity.serial_number:
            self._streamed.reply = serial_number_frame(int(identity.serial_number))
            self.port.write(Command.SERIAL_NUMBER)

    def may_have_forgotten(self, packet: DataPacket) -> bool:
        return may_be_volts(packet)

    def has_forgotten(self, packet: DataPacket, before: DataPacket, elapsed_s: float | None = None) -> bool:
        return is_volts(packet, before)

    def zero(self, argument: int, stopping: Callable[[], bool]) -> float | None:
        """Have the unit, held still, average its rate sensors and subtract the mean from then on.

        It answers `Z` when that is done and sends nothing meanwhile; one that has not answered in time may go on with
        it.
        """
        self.stop()
        command, began = zero_rates(argument), time.monotonic()
        found = exchange(
            self.port, reply_decoder(command), command, lambda event: isinstance(event, str),
            self.zeroing_patience_s(argument), stopping,
        )  # fmt: skip
        return None if found is None else time.monotonic() - began


def _no_answer(port: Port, heard: bytes) -> str:
    tried = "tried " + ", ".join(str(s) for s in SPEEDS) + " baud"
    if heard:
        start = heard[:8].hex(" ").upper()
        return (
            f"{port.name}: something answers, but not as a Crossbow IMU: {len(heard)} bytes, starting {start}"
            f" ({tried}). Is it another device, or another cable? Name the unit's own port."
        )
    return (
        f"{port.name} is silent: no answer to a ping ({tried}). Check that the unit has power (an IMU400CD takes 9 to"
        " 30 V), that transmit and receive are not swapped, and that this is its port."
    )


# ------------------------------------------------------------------------------------------------------------- volts

# Packets in volts and in scaled units have the same length and header. Two things distinguish them: voltage words have
# 12 bits, and both kinds of words agree about the motion.
# an eighth of the range within a packet's time; and no word of scaled packets in a row goes so far in three channels
_MOVED = 256
_JUMPED = 512
_JUMPS = 3


def may_be_volts(packet: DataPacket) -> bool:
    """Return True if all six words are possible as voltages."""
    words = _words(packet)
    return min(words) >= 0 and max(words) <= VOLTAGE_LIMITS[1]


def is_volts(packet: DataPacket, scaled: DataPacket) -> bool:
    """Return True if a packet has in volts the readings of another of about the same moment in scaled units."""
    if not may_be_volts(packet):
        return False
    now, then = _words(packet), _words(scaled)
    expected = [VOLTAGE_AT_REST + word // SCALED_A_VOLTAGE_COUNT for word in then]
    agrees = all(abs(word - volts) <= _MOVED for word, volts in zip(now, expected, strict=True))
    jumps = sum(abs(word - old) > _JUMPED for word, old in zip(now, then, strict=True))
    return agrees and jumps >= _JUMPS


def _words(packet: DataPacket) -> tuple[int, ...]:
    return (*packet.rates, *packet.accels)
