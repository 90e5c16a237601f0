"""Payloads of the 440, 380 and 381: the bytes of what stands in `messages`, both directions, all big-endian.

A payload that is not what its type has makes an `OtherFrame`, never an exception.
"""

import struct

from imutui.instrument.uut.frames import Frame, framed
from imutui.instrument.uut.messages import (
    Echo,
    FactoryWords,
    Fields,
    FieldsSet,
    GetFields,
    GetPacket,
    Identification,
    Measurement,
    Memory,
    OtherFrame,
    PacketS0,
    PacketS1,
    PacketS2,
    Ping,
    ReadFactoryWords,
    Refused,
    Reply,
    Request,
    Reset,
    SetFields,
    StatusWords,
    Version,
)

PING, ECHO, RESET, GET_PACKET = b"PK", b"CH", b"SR", b"GP"
IDENTIFICATION, VERSION, STATUS = b"ID", b"VR", b"T0"
FACTORY_WORDS = b"RE"
REFUSED = b"\x15\x15"
GET = {Memory.RAM: b"GF", Memory.EEPROM: b"RF"}
SET = {Memory.RAM: b"SF", Memory.EEPROM: b"WF"}
_MEMORY = {kind: memory for kinds in (GET, SET) for memory, kind in kinds.items()}

# "Accelerations, rates, magnetometer, temperatures of the rate sensors: X, Y, Z each; board temperature, time, BIT."
_S0 = struct.Struct(">13h2H")
# "Accelerations, rates, temperatures of the rate sensors: X, Y, Z each; board temperature, counter, BIT."
_S1 = struct.Struct(">10h2H")
# "Changes of velocity and of angle: X, Y, Z each; counter, BIT."
_S2 = struct.Struct(">6i2H")
_STATUS = struct.Struct(">14H")
_SERIAL = struct.Struct(">I")
_FACTORY = struct.Struct(">HB")


def read_request(frame: Frame) -> Request:
    """What a frame from the host asks for."""
    payload = frame.payload
    match frame.type, len(payload):
        case (b"PK", 0):
            return Ping()
        case (b"SR", 0):
            return Reset()
        case (b"CH", _):
            return Echo(payload)
        case (b"GP", 2):
            return GetPacket(payload)
        case (b"GF" | b"RF", _) if ids := _listed(payload, ">H"):
            return GetFields(_MEMORY[frame.type], tuple(each for (each,) in ids))
        case (b"SF" | b"WF", _) if pairs := _listed(payload, ">HH"):
            return SetFields(_MEMORY[frame.type], tuple((number, value) for number, value in pairs))
        case (b"RE", 3):
            return ReadFactoryWords(*_FACTORY.unpack(payload))
    return OtherFrame(frame.type, payload)


def read_reply(frame: Frame) -> Measurement | Reply:
    """What a frame from the unit says."""
    payload = frame.payload
    match frame.type, len(payload):
        case (b"S0", _S0.size) | (b"S1", _S1.size) | (b"S2", _S2.size):
            return _measurement(frame)
        case (b"PK", 0):
            return Ping()
        case (b"SR", 0):
            return Reset()
        case (b"CH", _):
            return Echo(payload)
        case (b"\x15\x15", 2):
            return Refused(payload)
        case (b"ID", length) if length >= _SERIAL.size:
            return _identification(payload)
        case (b"VR", 5):
            return Version(*payload)
        case (b"T0", _STATUS.size):
            return StatusWords(_STATUS.unpack(payload))
        case (b"GF" | b"RF", _) if pairs := _listed(payload, ">HH"):
            return Fields(_MEMORY[frame.type], tuple((number, value) for number, value in pairs))
        case (b"SF" | b"WF", _) if ids := _listed(payload, ">H"):
            return FieldsSet(_MEMORY[frame.type], tuple(each for (each,) in ids))
        case (b"RE", length) if length >= _FACTORY.size and length == _FACTORY.size + 2 * payload[2]:
            address, count = _FACTORY.unpack_from(payload)
            return FactoryWords(address, struct.unpack_from(f">{count}H", payload, _FACTORY.size))
    return OtherFrame(frame.type, payload)


def encode(message: Request | Reply | Measurement) -> bytes:
    """Write a request, a reply or a measurement as it goes over the line.

    `message`: anything that either decoder returns, but `Discarded`.
    Raises ValueError if a field does not fit its place on the line.
    """
    try:
        return framed(frame_of(message))
    except struct.error as error:
        raise ValueError(f"`message` has a number that does not fit its place: {message}") from error


def frame_of(message: Request | Reply | Measurement) -> Frame:
    """Frame of a request, a reply or a measurement; struct.error where a number does not fit."""
    match message:
        case PacketS0() | PacketS1() | PacketS2():
            return _frame_of_measurement(message)
        case Ping():
            return Frame(PING)
        case Reset():
            return Frame(RESET)
        case Echo(payload):
            return Frame(ECHO, payload)
        case OtherFrame(kind, payload):
            return Frame(kind, payload)
        case GetPacket(kind):
            return Frame(GET_PACKET, kind)
        case Refused(kind):
            return Frame(REFUSED, kind)
        case GetFields(memory, ids):
            return Frame(GET[memory], _list_of(ids))
        case FieldsSet(memory, ids):
            return Frame(SET[memory], _list_of(ids))
        case Fields(memory, values):
            return Frame(GET[memory], _list_of_pairs(values))
        case SetFields(memory, values):
            return Frame(SET[memory], _list_of_pairs(values))
        case ReadFactoryWords(address, count):
            return Frame(FACTORY_WORDS, _FACTORY.pack(address, count))
        case FactoryWords(address, words):
            return Frame(FACTORY_WORDS, _FACTORY.pack(address, len(words)) + struct.pack(f">{len(words)}H", *words))
        case Identification(number, text):
            return Frame(IDENTIFICATION, _SERIAL.pack(number) + _ascii(text) + b"\0")
        case Version(major, minor, patch, stage, build):
            return Frame(VERSION, struct.pack("5B", major, minor, patch, stage, build))
        case StatusWords(words):
            return Frame(STATUS, _STATUS.pack(*words))


def _measurement(frame: Frame) -> Measurement:
    if frame.type == b"S0":
        ax, ay, az, gx, gy, gz, mx, my, mz, tx, ty, tz, board, time, bit = _S0.unpack(frame.payload)
        return PacketS0((ax, ay, az), (gx, gy, gz), (mx, my, mz), (tx, ty, tz), board, time, bit)
    if frame.type == b"S1":
        ax, ay, az, gx, gy, gz, tx, ty, tz, board, counter, bit = _S1.unpack(frame.payload)
        return PacketS1((ax, ay, az), (gx, gy, gz), (tx, ty, tz), board, counter, bit)
    vx, vy, vz, wx, wy, wz, counter, bit = _S2.unpack(frame.payload)
    return PacketS2((vx, vy, vz), (wx, wy, wz), counter, bit)


def _frame_of_measurement(packet: Measurement) -> Frame:
    match packet:
        case PacketS0(accels, rates, magnetics, temperatures, board, time, bit):
            return Frame(b"S0", _S0.pack(*accels, *rates, *magnetics, *temperatures, board, time, bit))
        case PacketS1(accels, rates, temperatures, board, counter, bit):
            return Frame(b"S1", _S1.pack(*accels, *rates, *temperatures, board, counter, bit))
        case PacketS2(velocities, angles, counter, bit):
            return Frame(b"S2", _S2.pack(*velocities, *angles, counter, bit))


def _identification(payload: bytes) -> Identification:
    (number,) = _SERIAL.unpack_from(payload)
    text = payload[_SERIAL.size :].removesuffix(b"\0")
    return Identification(number, text.decode("ascii", "backslashreplace"))


def _ascii(text: str) -> bytes:
    if not text.isascii():
        raise ValueError(f"`text` must be ASCII, not {text!r}")
    return text.encode("ascii")


def _listed(payload: bytes, each: str) -> list[tuple[int, ...]]:
    """Entries of a payload that begins with their number; none if the length does not match, or the number is 0."""
    if not payload or len(payload) != 1 + payload[0] * struct.calcsize(each):
        return []
    return list(struct.iter_unpack(each, payload[1:])) if payload[0] else []


def _list_of(ids: tuple[int, ...]) -> bytes:
    return struct.pack(f">B{len(ids)}H", len(ids), *ids)


def _list_of_pairs(values: tuple[tuple[int, int], ...]) -> bytes:
    return struct.pack(f">B{2 * len(values)}H", len(values), *(word for pair in values for word in pair))
