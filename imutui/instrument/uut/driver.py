"""The driver of a 440, 380 or 381: its data, and the dialogue in frames.

The unit keeps its own speed. Fields are set in RAM only, and put back on leaving; nothing is written to EEPROM.
"""

from collections.abc import Callable, Iterable
from dataclasses import replace

from imutui.instrument import counts, names
from imutui.instrument.counter_spec import CounterSpec
from imutui.instrument.counts import DataPacket
from imutui.instrument.driver import Driver, Identity, InstrumentError, PacketStream, Poller, exchange, origin_of
from imutui.instrument.frame_search import Discarded
from imutui.instrument.port import Port, PortError
from imutui.instrument.uut.counter import COUNTS_PER_SECOND, CounterWatch
from imutui.instrument.uut.decoder import BARE_PING, Decoder, frame_decoder
from imutui.instrument.uut.fields import ORIENTATIONS, QUIET, RATE_OF_DIVIDER, S1, Field, fits_line, in_words
from imutui.instrument.uut.frames import FIXED_LENGTHS, OVERHEAD_BYTES, Frame, framed
from imutui.instrument.uut.messages import (
    GET_PACKET,
    PING,
    REFUSED,
    RESET,
    SCALING,
    SERIAL_BYTES,
    Memory,
    PacketS0,
    PacketS1,
    content_of,
    identification,
    names_of_bits,
    numbers,
    numbers_in,
    pairs,
    pairs_in,
)
from imutui.plain_text import NAME_LIMIT, NOTE_LIMIT, one_line

# "2, 3, 5 and 6" of the field BAUD, and those that only the 440 and the 380 have.
SPEEDS = (115200, 57600, 38400, 230400, 19200, 9600)
_USUAL_SPEEDS = SPEEDS[:4]

_PING_S = 0.15
_SLOW_PING_S = 1.5  # other programs wait for about a second
_OWN = (Field.RATE_DIVIDER, Field.BAUD, Field.PACKET_TYPE, Field.LOW_PASS_5, Field.LOW_PASS_6, Field.ORIENTATION)
# types of what a unit may answer amid a stream
_REPLIES = (b"PK", b"ID", b"VR", REFUSED, *Memory.RAM.value, *Memory.EEPROM.value)


class Imu381(Driver):
    """Aceinna's IMU381, MEMSIC's IMU380, Crossbow's IMU440.

    Replies stand between the packets of a stream, so the unit can be asked while it streams.
    """

    name = names.IMU381
    models = ("IMU381", "IMU380", "DMU380", "DMU381", "IMU440")
    model = "IMU381ZA"
    power_up_bauds = _USUAL_SPEEDS
    packet_bytes = FIXED_LENGTHS[b"S1"] + OVERHEAD_BYTES
    rates_hz = tuple(map(float, RATE_OF_DIVIDER.values()))
    accel_sign = 1
    turns_axes = True
    mode = "packets S1"
    mode_words = "packets S1: rates, forces, four temperatures, status word"
    # time, 65536 counts a second, so that it wraps each second
    counter = CounterSpec(1e9 / COUNTS_PER_SECOND, 1e-3, +1)
    # ranges of the words, the same for all of the family: the sensors of each are good for less
    rate_range_dps = 630.0
    accel_range_g = 10.0
    status_names = staticmethod(names_of_bits)
    as_after_power_up = "the unit sends other packets than it was told to, or its counter began anew, as after power-up"
    streams_from_power_up = True
    _stop_command = framed(Frame(Memory.RAM.write, pairs([(Field.RATE_DIVIDER, QUIET)])))

    def __init__(self, port: Port, rate_hz: float | None = None) -> None:
        super().__init__(port, rate_hz)
        self._own: dict[int, int] = {}
        self._changed = False
        self._divider = QUIET
        self._watch: CounterWatch | None = None

    @staticmethod
    def scaling(rate_range_dps: float, accel_range_g: float) -> counts.Scaling:
        return SCALING

    # ----------------------------------------------------------------------------------------- finding and setting up

    def find(self) -> Identity:
        self._find_speed(_USUAL_SPEEDS)
        return self._identify()

    def answers(self, baud: int | None = None) -> bool:
        for speed in SPEEDS if baud is None else (baud,):
            # the bare ping, without length and sum: an IMU400CD makes nothing of it
            found = self._at(speed, BARE_PING, lambda event: not isinstance(event, Discarded))
            # a line that echoes returns the ping; a whole frame of a stream is proof enough
            if found is not None and (found != PING or self._answers_questions()):
                return True
        return False

    def open(
        self,
        baud: int | None,
        *,
        accept: Callable[[Identity], None] = lambda identity: None,
        thorough: bool = True,
    ) -> Identity:
        """Find the unit, identify it, read its fields and set its type of packet; it is quiet afterwards."""
        speeds = SPEEDS if thorough else _USUAL_SPEEDS
        self._find_speed(dict.fromkeys((self.port.baud, baud or SPEEDS[0], *speeds)), thorough=thorough)
        identity = self._identify()
        accept(identity)
        own = self.fields(_OWN)
        if Field.PACKET_TYPE not in own or Field.RATE_DIVIDER not in own:
            raise InstrumentError(f"{self.port.name}: the unit does not say its configuration. Power it off and on.")
        # a unit that was found again may still have the fields that were set here
        self._own = self._own or own
        self._divider = self._divider_for(self._rate_hz)
        self.stream_hz = float(RATE_OF_DIVIDER.get(self._divider, 0))
        self._changed = True
        self.stop()
        if not self.set_up() or self.fields((Field.PACKET_TYPE,)).get(Field.PACKET_TYPE) != S1:
            raise InstrumentError(f"{self.port.name}: the unit refuses packets of type S1, so it gives no readings.")
        orientation = ORIENTATIONS.get(self._own.get(Field.ORIENTATION, -1))
        own_mount = "" if orientation is None else orientation.mount
        return replace(identity, configuration=one_line(in_words(self._own), NOTE_LIMIT), own_mount=own_mount)

    def set_up(self) -> bool:
        return self.put({Field.PACKET_TYPE: S1})

    def leave(self) -> str:
        """Put its own type and rate of packets back, if they were changed."""
        if not self._changed:
            return ""
        self.stop()
        own = {int(field): self._own[field] for field in (Field.PACKET_TYPE, Field.RATE_DIVIDER) if field in self._own}
        # both at once: one of them may not go with the present value of the other
        self.put(own)
        left = self.fields(own)
        # a unit that does not answer any more is not asked again: the caller waits for this
        if left and left != own:
            for field in own:
                self.put({field: own[field]})
            left = self.fields(own)
        if left and left != own and self.fields(own, Memory.EEPROM) == own:
            # some refuse while they run what they accept at a restart
            left = own if self.ask(RESET, tries=1) is not None else left
        self._changed = False
        if left == own:
            return ""
        has = f"it has {in_words(left)}" if left else "it does not say what it has"
        return f"the unit was found with {in_words(own)} and does not take that back: {has} until its power goes"

    # ------------------------------------------------------------------------------------------------------- requests

    def fields(self, ids: Iterable[int], memory: Memory = Memory.RAM) -> dict[int, int]:
        """Return fields in force, or those of the next power-up, as far as the unit has them."""
        ids = tuple(map(int, ids))
        request = Frame(memory.read, numbers(ids))
        reply = self.ask(request, lambda payload: set() < dict(pairs_in(payload)).keys() <= set(ids))
        return dict(pairs_in(reply or b""))

    def put(self, values: dict[int, int]) -> bool:
        """Put fields in force until the next power-up; returns True if the unit has taken all of them."""
        request = Frame(Memory.RAM.write, pairs(values.items()))
        reply = self.ask(request, lambda payload: set() < set(numbers_in(payload)) <= values.keys())
        return set(values) <= set(numbers_in(reply or b""))

    def ask(self, request: Frame, fits: Callable[[bytes], bool] = lambda payload: True, tries: int = 2) -> bytes | None:
        """Send a request and return the payload of its reply; None if it does not come, or the unit refuses."""
        refusal = Frame(REFUSED, request.type)
        kind = request.payload if request.type == GET_PACKET else request.type

        def is_reply(event: object) -> bool:
            return event == refusal or (isinstance(event, Frame) and event.type == kind and fits(event.payload))

        for _ in range(tries):
            found = exchange(self.port, Decoder(), framed(request), is_reply)
            if isinstance(found, Frame):
                return None if found == refusal else found.payload
        return None

    def _answers_questions(self) -> bool:
        """Return True if a question is answered; an echo of it looks like the answer to a ping only."""
        return any(self.ask(Frame(GET_PACKET, kind), tries=1) is not None for kind in (b"ID", b"VR"))

    def _at(
        self,
        speed: int,
        ping: bytes,
        wanted: Callable[[PacketS1 | Frame | Discarded], bool] = lambda event: event == PING,
        patience_s: float = _PING_S,
    ) -> PacketS1 | Frame | Discarded | None:
        """Send a ping at a speed, and return the first wanted event."""
        self.port.set_baud(speed)
        self.port.discard_input()
        return exchange(self.port, Decoder(), ping, wanted, patience_s)

    def _find_speed(self, speeds: Iterable[int], *, thorough: bool = False) -> None:
        """Find the speed at which the unit answers a ping; the port is left at it."""
        waits = [(speed, _PING_S) for speed in speeds]
        if thorough:
            # "a frame must arrive within 4 s": the unit then has given up a frame that a former host left unfinished
            waits += [(speed, _SLOW_PING_S) for speed, _ in waits if speed in _USUAL_SPEEDS] + waits
        # the unit may know only the bare ping, hence that one is before the whole one
        if not any(self._at(speed, BARE_PING + framed(PING), patience_s=wait_s) for speed, wait_s in waits):
            raise InstrumentError(
                f"{self.port.name}: no answer to a ping as an IMU381 gives it (tried"
                f" {', '.join(map(str, SPEEDS))} baud). Check that the unit has power, that transmit and receive are"
                " not swapped, that its line is the serial one, and that this is its port."
            )

    def _identify(self) -> Identity:
        said = self.ask(Frame(GET_PACKET, b"ID"), lambda payload: len(payload) >= SERIAL_BYTES)
        version = self.ask(Frame(GET_PACKET, b"VR"))
        if said is None and version is None and not self.fields(_OWN):
            raise InstrumentError(
                f"{self.port.name}: a ping comes back, but no question is answered. The device, or its adapter, echoes"
                " what is sent. Name the unit's own port."
            )
        serial_number, text = ("", "") if said is None else identification(said)
        text, source = origin_of(text)
        number = "" if version is None else " " + ".".join(map(str, version))
        return Identity(serial_number, one_line(text + number, NAME_LIMIT), source)

    def _divider_for(self, rate_hz: float | None) -> int:
        """Return the divider of a rate; that of the fastest rate on this line if the unit does not have the rate."""
        fits = {
            hz: divider
            for divider, hz in RATE_OF_DIVIDER.items()
            if fits_line(hz, FIXED_LENGTHS[b"S1"], self.port.baud)
        }
        if rate_hz is None:
            return QUIET
        exact = next((divider for hz, divider in fits.items() if hz == rate_hz), None)
        if exact is not None:
            return exact
        if not fits or max(fits) < rate_hz:
            raise InstrumentError(
                f"{self.port.name}: the line of {self.port.baud} baud does not carry {rate_hz:g} Hz; it carries"
                f" {max(fits, default=0):g} Hz: --rate."
            )
        return fits[max(fits)]

    # -------------------------------------------------------------------------------------------------------- packets

    def start(self) -> None:
        """Have the unit stream; that it does shows in the packets."""
        self._watch = CounterWatch(RATE_OF_DIVIDER[self._divider])
        self.port.write(framed(Frame(Memory.RAM.write, pairs([(Field.RATE_DIVIDER, self._divider)]))))

    def packets(self) -> PacketStream:
        return frame_decoder(self._streamed)

    def _streamed(self, frame: Frame) -> PacketS1 | Discarded | None:
        """Return the event of a frame in a stream; raises PortError if the unit refuses to stream."""
        packet = content_of(frame)
        if isinstance(packet, PacketS1):
            return packet
        if frame == Frame(REFUSED, Memory.RAM.write):
            raise PortError(
                f"{self.port.name}: the unit refuses a stream of {self.stream_hz:g} Hz. Ask for another rate: --rate."
            )
        # what was not asked for: S2, perhaps, or attitudes
        return None if frame.type in _REPLIES else Discarded(framed(frame), bad_checksum=False)

    def poller(self, giving_up: Callable[[], bool]) -> Poller:
        request = framed(Frame(GET_PACKET, b"S1")), PacketS1
        return Poller(self, giving_up, Decoder(), request, (framed(PING), lambda event: event == PING))

    def ask_for_life(self) -> None:
        self.port.write(framed(PING))

    def ask_amid(self, identity: Identity) -> None:
        """Ping: "replies are interleaved with the continuous packets"."""
        self.ask_for_life()

    def has_forgotten(self, packet: DataPacket, before: DataPacket, elapsed_s: float | None = None) -> bool:
        """Return True if packets are of another type or rate than asked for, or their counter began anew."""
        if isinstance(packet, PacketS0):
            return True
        return self._watch is not None and self._watch.began_anew(packet.ticks, elapsed_s)
