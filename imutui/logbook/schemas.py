"""The messages in a log: ROS 2 definitions, our own beside them, and records to and from CDR bytes.

Every channel is `ros2msg`/`cdr`: the one encoding that the common viewers, rosbags and ROS 2 itself all open.
"""

import struct
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache
from typing import Any, TypeAlias

import numpy as np

from imutui.logbook import message_definitions

RAW = "/imu/raw"
IMU = "/imu/data_raw"
TEMPERATURE = "/imu/temperature"
REFERENCE = "/table/reference"
ESTIMATE = "/filter/estimate"
DIAGNOSTICS = "/diagnostics"
EVENTS = "/rosout"
TRANSFORMS = "/tf_static"
STATE = "/table/state"

TYPES = {
    RAW: "imutui_msgs/msg/RawPacket",
    IMU: "sensor_msgs/msg/Imu",
    TEMPERATURE: "sensor_msgs/msg/Temperature",
    REFERENCE: "imutui_msgs/msg/TableReference",
    ESTIMATE: "imutui_msgs/msg/Estimate",
    DIAGNOSTICS: "diagnostic_msgs/msg/DiagnosticArray",
    EVENTS: "rcl_interfaces/msg/Log",
    TRANSFORMS: "tf2_msgs/msg/TFMessage",
    STATE: "imutui_msgs/msg/TableState",
}
"""In the order of their channels' numbers: `recover` knows a channel by its number, so what is new comes last."""
S1_PACKET = "imutui_msgs/msg/S1Packet"  # type of `RAW` in logs of a unit whose packets have details
_FOREVER = "{sec: 9223372036, nsec: 854775807}"
_LATCHED = f"""\
- history: keep_last
  depth: 1
  reliability: reliable
  durability: transient_local
  deadline: {_FOREVER}
  lifespan: {_FOREVER}
  liveliness: automatic
  liveliness_lease_duration: {_FOREVER}
  avoid_ros_namespace_conventions: false
"""
CHANNEL_METADATA = {TRANSFORMS: {"offered_qos_profiles": _LATCHED}}
"""What a channel says beside its type: how ROS 2 (Iron and later) publishes it, so that whoever comes late gets it."""

DESCRIPTION = ("note", "operator")
"""What of the session may be changed while a file is written: from then on its diagnostics say it each second."""

FLAG_LOST_BEFORE = 1
FLAG_HOST_STAMP = 2
FLAG_LIMIT = 4

# CDR, little endian: 4 bytes of encapsulation, then fields aligned to their own size, counted from after those 4
_RAW = struct.Struct("<4xQq6hHHBB")
_S1 = struct.Struct("<4xQq6hHHBB3hhH")
_CDR_HEADER = b"\x00\x01\x00\x00"
RAW_DTYPE = np.dtype(
    {
        "names": ["sequence", "host_monotonic_ns", "counts", "temperature", "ticks", "mode", "flags",
                  "rate_temperatures", "board_temperature", "status"],
        "formats": ["<u8", "<i8", ("<i2", 6), "<u2", "<u2", "u1", "u1", ("<i2", 3), "<i2", "<u2"],
        "offsets": [4, 12, 20, 32, 34, 36, 37, 38, 44, 46],
        "itemsize": 48,
    }
)  # fmt: skip
"""Raw packets as an array reads them: the bytes of `encode_raw`, one packet a record; no details are zeros."""
# header (stamp, length of the frame_id with its NUL, frame_id, padding), then the numbers of sensor_msgs/Imu
_IMU = struct.Struct("<4siII13s7x4d9d3d9d3d9d")
_TEMPERATURE = struct.Struct("<4siII9s3x2d")
_ESTIMATE = struct.Struct("<4siII13s7x31dB6?")
# stamp and level of rcl_interfaces/Log; number of statuses and level of the first one in diagnostic_msgs
_EVENT = struct.Struct("<4xiIB")
_STATUS = struct.Struct("<IB")
_UINT32 = struct.Struct("<I")
_CDR_STAMP = 12  # bytes up to the frame_id of a message with a header
_IMU_FRAME, _IMU_LINK = "imu_link_ned", "imu_link"
"""Names of REP-145: x forward, y right, z down, the axes that samples are in; and x forward, y left, z up."""
_PLAIN_ESTIMATES = {(struct.pack("<I", 13), _ESTIMATE.size), (struct.pack("<I", 9), _ESTIMATE.size - 8)}
"""Length of the frame_id, and size, of estimates as they are written, and as they were with the frame `imu_body`."""
NO_ESTIMATE = -1.0  # first element of a covariance of sensor_msgs/Imu whose quantity has no estimate
_ZEROS = (0.0,) * 8


@cache
def typestore() -> Any:
    """Store of the types that logs have."""
    # what of our own messages is read by hand needs none
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.EMPTY)
    types: dict[str, Any] = {}
    for name, text in (message_definitions.ROS | message_definitions.OWN).items():
        types.update(get_types_from_msg(text, name))
    store.register(types)
    return store


def definition(typename: str) -> str:
    """Text of a message type with all it is built from, as MCAP's `ros2msg` encoding wants it."""
    return str(typestore().generate_msgdef(typename, ros_version=2)[0])


class UndecodableError(Exception):
    """Bytes are no message of the type that their topic has."""


_MALFORMED = (struct.error, ValueError, IndexError, KeyError, TypeError, OverflowError, MemoryError, RecursionError)
"""How bytes that are no such message fail in a decoder, whichever way it meets them first."""


@dataclass(frozen=True, slots=True)
class LogEvent:
    """A mark of the operator's or an event of the program's."""

    stamp_ns: int
    name: str
    text: str


Details = tuple[tuple[int, int, int], int, int]
"""What an S1Packet has more: temperatures of the rate sensors, of the board, and the status word; counts."""


@dataclass(frozen=True, slots=True)
class RawPacket:
    """A packet as it came off the line; see the message definitions RawPacket and, with details, S1Packet.

    `details` is None of a unit without.
    """

    sequence: int
    host_monotonic_ns: int
    counts: tuple[int, int, int, int, int, int]
    temperature: int
    ticks: int
    mode: int = 0
    flags: int = 0
    details: Details | None = None


def encode_raw(packet: RawPacket) -> bytes:
    """CDR bytes of a raw packet."""
    p = packet
    head = (p.sequence, p.host_monotonic_ns, *p.counts, p.temperature, p.ticks, p.mode, p.flags)
    if p.details is None:
        return _CDR_HEADER + _RAW.pack(*head)[4:]
    of_rates, of_board, status = p.details
    return _CDR_HEADER + _S1.pack(*head, *of_rates, of_board, status)[4:]


def encode_raws(raws: np.ndarray, *, details: bool) -> list[bytes]:
    """CDR bytes of raw packets, `encode_raw` of each, from records of `RAW_DTYPE`."""
    data = raws.view(np.uint8).reshape(raws.size, -1)[:, : _S1.size if details else _RAW.size]
    data[:, 1] = _CDR_HEADER[1]
    return _cut(data)


def _cut(rows: np.ndarray) -> list[bytes]:
    """The bytes of each row."""
    size, data = rows.nbytes // len(rows), rows.tobytes()
    return [data[at : at + size] for at in range(0, len(data), size)]


def decode_raw(data: bytes) -> RawPacket:
    """Raw packet from CDR bytes; raises UndecodableError if they are none."""
    has_details = len(data) == _S1.size
    layout = _S1 if has_details else _RAW
    try:
        sequence, host, a, b, c, d, e, f, temperature, ticks, mode, flags, *rest = layout.unpack(data)
    except struct.error as error:
        raise UndecodableError(str(error)) from error
    details = ((rest[0], rest[1], rest[2]), rest[3], rest[4]) if has_details else None
    return RawPacket(sequence, host, (a, b, c, d, e, f), temperature, ticks, mode, flags, details)


def is_own(topic: str, typename: str) -> bool:
    """Whether a type is one that our logs have on a topic."""
    return TYPES.get(topic) == typename or (topic == RAW and typename == S1_PACKET)


def raw_type(*, details: bool) -> str:
    """Type of `RAW` in a log of a unit whose packets have details, or have none."""
    return S1_PACKET if details else TYPES[RAW]


def encode(topic: str, message: Any) -> bytes:
    """CDR bytes of a message that belongs on `topic`."""
    return encode_as(TYPES[topic], message)


def encode_as(typename: str, message: Any) -> bytes:
    """CDR bytes of a message of a type."""
    return bytes(typestore().serialize_cdr(message, typename))


def decode(typename: str, data: bytes) -> Any:
    """Message from CDR bytes.

    Raises UndecodableError if the bytes are no such message.
    """
    from rosbags.serde import SerdeError

    types = typestore()
    try:
        return types.deserialize_cdr(data, typename)
    except (SerdeError, *_MALFORMED) as error:
        raise UndecodableError(str(error) or type(error).__name__) from error


def decoder_of(typename: str, definition: str) -> Callable[[bytes], Any]:
    """What makes messages from CDR bytes of a type that another program defined.

    `definition`: its text with all that it is built from, as MCAP's `ros2msg` encoding has it.
    Raises UndecodableError if the text is no definition.
    """
    from rosbags.serde import SerdeError
    from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore

    store = get_typestore(Stores.EMPTY)
    try:
        store.register(get_types_from_msg(definition, typename))
    except (TypesysError, *_MALFORMED) as error:
        raise UndecodableError(f"the definition of {typename} cannot be read: {error}") from error

    def decode_foreign(data: bytes) -> Any:
        try:
            return store.deserialize_cdr(data, typename)
        except (SerdeError, *_MALFORMED) as error:
            raise UndecodableError(str(error) or type(error).__name__) from error

    return decode_foreign


def decode_event(data: bytes) -> LogEvent:
    """Event from the CDR bytes of rcl_interfaces/Log; by hand, since a store of types takes longer than most commands.

    Raises as `decode` if the bytes are no such message.
    """
    try:
        seconds, nanoseconds, _ = _EVENT.unpack_from(data)
        texts, at = [], _EVENT.size
        for _ in range(4):
            text, at = _text(data, at)
            texts.append(text)
        whole = data[:4] == _CDR_HEADER and len(data) == _aligned(at) + 4
    except (struct.error, UndecodableError):
        whole = False
    if not whole:
        m = decode(TYPES[EVENTS], data)
        return LogEvent(m.stamp.sec * 1_000_000_000 + m.stamp.nanosec, m.name, m.msg)
    return LogEvent(seconds * 1_000_000_000 + nanoseconds, texts[0], texts[1])


def decode_diagnostics(data: bytes) -> dict[str, str] | None:
    """Values of the first status in the CDR bytes of diagnostic_msgs/DiagnosticArray, None if there is none; by hand.

    Raises as `decode` if the bytes are no such message.
    """
    try:
        values, at = _values(data)
        whole = data[:4] == _CDR_HEADER and len(data) == at
    except (struct.error, UndecodableError):
        whole = False
    if whole:
        return values
    m = decode(TYPES[DIAGNOSTICS], data)
    return {pair.key: pair.value for pair in m.status[0].values} if m.status else None


def _values(data: bytes) -> tuple[dict[str, str], int]:
    """Values of an array's only status, and where it ends; raises UndecodableError if it has another number of them."""
    _, at = _text(data, _CDR_STAMP)
    statuses, _ = _STATUS.unpack_from(data, at := _aligned(at))
    if statuses != 1:
        raise UndecodableError("not one status")
    at += _STATUS.size
    for _ in range(3):
        _, at = _text(data, at)
    (count,) = _UINT32.unpack_from(data, at := _aligned(at))
    at += _UINT32.size
    values = {}
    for _ in range(count):
        key, at = _text(data, at)
        values[key], at = _text(data, at)
    return values, at


def _aligned(at: int) -> int:
    """Offset of the next number of four bytes; they are aligned from after the encapsulation, which has four."""
    return (at + 3) // 4 * 4


def _text(data: bytes, at: int) -> tuple[str, int]:
    """String of a message, and where it ends."""
    (size,) = _UINT32.unpack_from(data, at := _aligned(at))
    first, last = at + _UINT32.size, at + _UINT32.size + size
    if size < 1 or last > len(data) or data[last - 1] != 0:
        raise UndecodableError("no string")
    try:
        return data[first : last - 1].decode(), last
    except UnicodeDecodeError as error:
        raise UndecodableError("no text") from error


def make(typename: str, **fields: Any) -> Any:
    """Message object of a type, to be filled and encoded."""
    return typestore().types[typename](**fields)


def header(stamp_ns: int, frame_id: str) -> Any:
    """std_msgs/Header with a stamp (UTC, ns) and the frame that the numbers are in."""
    return make("std_msgs/msg/Header", stamp=_time(stamp_ns), frame_id=frame_id)


def stamp_ns(message_header: Any) -> int:
    """Nanoseconds of a std_msgs/Header."""
    return int(message_header.stamp.sec) * 1_000_000_000 + int(message_header.stamp.nanosec)


def encode_imu(stamp: int, gyro: np.ndarray, accel: np.ndarray, *, valid: bool = True) -> bytes:
    """CDR bytes of sensor_msgs/Imu: angular rate (rad/s), specific force (m/s²) in body axes; orientation is unknown.

    A sample that is not `valid` says "no estimate" of both, as ROS does: their covariances begin with -1. Packed by
    hand, as all that comes with each sample: an hour at 133 Hz is half a million of them.
    """
    seconds, rest = divmod(stamp, 1_000_000_000)
    frame = _IMU_FRAME.encode() + b"\0"
    covariance = (0.0 if valid else NO_ESTIMATE, *_ZEROS)
    head = (_CDR_HEADER, seconds, rest, len(frame), frame)
    orientation = (0.0, 0.0, 0.0, 1.0, NO_ESTIMATE, *_ZEROS)
    return _IMU.pack(*head, *orientation, *map(float, gyro), *covariance, *map(float, accel), *covariance)


def encode_imus(stamps: np.ndarray, gyro: np.ndarray, accel: np.ndarray, valid: np.ndarray) -> list[bytes]:
    """`encode_imu` of each of some samples, shapes (N,), (N, 3), (N, 3), (N,)."""
    rows = _copies(_IMU_TEMPLATE, stamps.size)
    rows["sec"], rows["nsec"] = np.divmod(stamps, 1_000_000_000)
    rows["gyro"], rows["accel"] = gyro, accel
    rows["gyro_covariance"][~valid, 0] = rows["accel_covariance"][~valid, 0] = NO_ESTIMATE
    return _cut(rows)


def transforms(stamp: int) -> Any:
    """tf2_msgs/TFMessage from `imu_link` (x forward, y left, z up) to the frame of the samples: half a turn about x."""
    half_turn = make("geometry_msgs/msg/Quaternion", x=1.0, y=0.0, z=0.0, w=0.0)
    nowhere = make("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0)
    transform = make(
        "geometry_msgs/msg/TransformStamped",
        header=header(stamp, _IMU_LINK),
        child_frame_id=_IMU_FRAME,
        transform=make("geometry_msgs/msg/Transform", translation=nowhere, rotation=half_turn),
    )
    return make(TYPES[TRANSFORMS], transforms=[transform])


def encode_estimate(stamp: int, numbers: list[float], dof: int, converged: tuple[bool, ...]) -> bytes:
    """CDR bytes of imutui_msgs/Estimate: its 31 numbers in the order of the definition, rows of NIS, six verdicts."""
    seconds, rest = divmod(stamp, 1_000_000_000)
    frame = _IMU_FRAME.encode() + b"\0"
    return _ESTIMATE.pack(_CDR_HEADER, seconds, rest, len(frame), frame, *numbers, dof, *converged)


def is_plain_estimate(data: bytes) -> bool:
    """Whether bytes are laid out as by `encode_estimate`, today or once: then nothing that is decoded could fail."""
    return data[:4] == _CDR_HEADER and (data[12:16], len(data)) in _PLAIN_ESTIMATES


def encode_temperature(stamp: int, degc: float) -> bytes:
    """CDR bytes of sensor_msgs/Temperature inside the instrument's case."""
    seconds, rest = divmod(stamp, 1_000_000_000)
    return _TEMPERATURE.pack(_CDR_HEADER, seconds, rest, 9, b"imu_case\0", degc, 0.0)


def encode_temperatures(stamps: np.ndarray, degc: np.ndarray) -> list[bytes]:
    """`encode_temperature` of each of some samples, shapes (N,)."""
    rows = _copies(_TEMPERATURE_TEMPLATE, stamps.size)
    rows["sec"], rows["nsec"] = np.divmod(stamps, 1_000_000_000)
    rows["degc"][:, 0] = degc
    return _cut(rows)


_Template: TypeAlias = tuple[bytes, np.dtype[Any]]


def _template(data: bytes, **numbers: tuple[int, int]) -> _Template:
    """A message to be copied, and where its stamp and some of its numbers are: offset, and how many."""
    fields = {name: (np.dtype(("<f8", (count,))), at) for name, (at, count) in numbers.items()}
    stamp = {"sec": (np.dtype("<i4"), 4), "nsec": (np.dtype("<u4"), 8)}
    places = stamp | fields
    return data, np.dtype(
        {
            "names": list(places),
            "formats": [kind for kind, _ in places.values()],
            "offsets": [at for _, at in places.values()],
            "itemsize": len(data),
        }
    )


def _copies(template: _Template, count: int) -> np.ndarray:
    """So many of a message, to be filled."""
    data, kind = template
    return np.frombuffer(bytearray(data * count), kind)


# where the angular rate begins: a covariance, a vector and a covariance follow it
_GYRO = _IMU.size - 8 * (3 + 9 + 3 + 9)
_IMU_TEMPLATE = _template(
    encode_imu(0, np.zeros(3), np.zeros(3)),
    gyro=(_GYRO, 3),
    gyro_covariance=(_GYRO + 24, 9),
    accel=(_GYRO + 96, 3),
    accel_covariance=(_GYRO + 120, 9),
)
_TEMPERATURE_TEMPLATE = _template(encode_temperature(0, 0.0), degc=(_TEMPERATURE.size - 16, 1))


def encode_table_reference(stamp: int, kind: str, angles_deg: Iterable[float], rates_dps: Iterable[float]) -> bytes:
    """CDR bytes of imutui_msgs/TableReference: what is known of the table, three angles (deg) and rates (deg/s)."""
    seconds, rest = divmod(stamp, 1_000_000_000)
    text = kind.encode() + b"\0"
    # numbers are aligned to 8 bytes counted from after the encapsulation's 4; 24 come before the text
    room = (24 + len(text) + 7) // 8 * 8 - 24
    layout = f"<4siII6s2xI{room}s6d"
    return struct.pack(layout, _CDR_HEADER, seconds, rest, 6, b"table\0", len(text), text, *angles_deg, *rates_dps)


def encode_table_state(
    stamp: int, uncertainty_ns: int, angles_deg: Iterable[float], rates_dps: Iterable[float], mode: str, fault: str
) -> bytes:
    """CDR bytes of imutui_msgs/TableState: what the table's controller said of its angles (deg) and rates (deg/s)."""
    seconds, rest = divmod(stamp, 1_000_000_000)
    texts = [text.encode() + b"\0" for text in (mode, fault)]
    room = _aligned(len(texts[0]))
    layout = f"<4siII6s6x6dQI{room}sI{len(texts[1])}s"
    numbers = *angles_deg, *rates_dps, uncertainty_ns
    words = len(texts[0]), texts[0], len(texts[1]), texts[1]
    return struct.pack(layout, _CDR_HEADER, seconds, rest, 6, b"table\0", *numbers, *words)


def diagnostics(stamp: int, level: int, message: str, values: dict[str, str]) -> Any:
    """diagnostic_msgs/DiagnosticArray with one status; level 0 ok, 1 warning, 2 error."""
    pair = typestore().types["diagnostic_msgs/msg/KeyValue"]
    status = make(
        "diagnostic_msgs/msg/DiagnosticStatus",
        level=level,
        name="imutui: acquisition",
        message=message,
        hardware_id=values.get("serial_number", ""),
        values=[pair(key=key, value=value) for key, value in values.items()],
    )
    return make(TYPES[DIAGNOSTICS], header=header(stamp, ""), status=[status])


def event(stamp: int, name: str, text: str, level: int = 20) -> Any:
    """rcl_interfaces/Log; level 20 info, 30 warn, 40 error.

    Name "mark" for the operator's, "acquisition" for the program's, "remark" for what an operator says while guided
    through a profile: it begins no segment, as a mark would.
    """
    return make(TYPES[EVENTS], stamp=_time(stamp), level=level, name=name, msg=text, file="", function="", line=0)


def _time(ns: int) -> Any:
    return make("builtin_interfaces/msg/Time", sec=ns // 1_000_000_000, nanosec=ns % 1_000_000_000)
