"""The messages of a log: topics, their types, and the conversion of values to and from CDR bytes.

Every channel is `ros2msg`/`cdr`, the encoding that the common viewers, rosbags and ROS 2 itself open.
"""

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from imutui.logbook import layout, message_definitions

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
"""In the order of their channels' numbers. `recover` knows a channel by its number, so a new one comes last."""
S1_PACKET = (
    "imutui_msgs/msg/S1Packet"  # type of `RAW` in logs of a unit whose packets have details (temperatures, status)
)
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
"""Metadata of channels: ROS 2 (Iron and later) publishes a latched one again to late subscribers."""

DESCRIPTION = ("note", "operator")
"""Fields of the session that may change while a file is written; its diagnostics repeat them each second."""

FLAG_LOST_BEFORE = 1
FLAG_HOST_STAMP = 2
FLAG_LIMIT = 4

RAW_DTYPE = layout.blanks(S1_PACKET, 0).dtype
"""Packets as records: `S1_PACKET`, of which `RawPacket` is the beginning; a unit without details has zeros in them."""
NO_ESTIMATE = -1.0  # first element of a covariance of sensor_msgs/Imu whose quantity has no estimate
_IMU_FRAME, _IMU_LINK = "imu_link_ned", "imu_link"
"""Names of REP-145: x forward, y right, z down, the axes that samples are in; and x forward, y left, z up."""
_SECOND = 1_000_000_000


@cache
def _typestore() -> Any:
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.EMPTY)
    types: dict[str, Any] = {}
    for name, text in (message_definitions.ROS | message_definitions.OWN).items():
        types.update(get_types_from_msg(text, name))
    store.register(types)
    return store


@cache
def definition(typename: str) -> str:
    """Return the text of a message type with the types it is built from, as MCAP's `ros2msg` encoding wants it."""
    return str(_typestore().generate_msgdef(typename, ros_version=2)[0])


def is_own(topic: str, typename: str) -> bool:
    """Return whether our logs have a type on a topic."""
    return TYPES.get(topic) == typename or (topic == RAW and typename == S1_PACKET)


def raw_type(*, details: bool) -> str:
    """Return the type of `RAW` in a log of a unit whose packets have details, or have none."""
    return S1_PACKET if details else TYPES[RAW]


# -------------------------------------------------------------------------------------------------------------- writing
# Arguments are of one message, or arrays with a row a message; each function returns a list with the bytes of each.


def _stamped(topic: str, stamps: ArrayLike, **texts: str) -> np.ndarray:
    stamps = np.atleast_1d(np.asarray(stamps, np.int64))
    records = layout.blanks(TYPES[topic], stamps.size, **texts)
    records["header.stamp.sec"], records["header.stamp.nanosec"] = np.divmod(stamps, _SECOND)
    return records


def encode_raws(packets: np.ndarray, *, details: bool) -> list[bytes]:
    """Return packets as messages, from records of `RAW_DTYPE`."""
    records = layout.blanks(raw_type(details=details), packets.size)
    for name in records.dtype.names or ():
        records[name] = packets[name]
    return layout.cut(records)


def encode_imus(stamps: ArrayLike, gyro: ArrayLike, accel: ArrayLike, valid: ArrayLike = True) -> list[bytes]:
    """Return samples as sensor_msgs/Imu: angular rate (rad/s), specific force (m/s²), body axes; no orientation.

    A sample that is not `valid` has no estimate of either, as ROS states it: their covariances begin with -1.
    """
    records = _stamped(IMU, stamps, header__frame_id=_IMU_FRAME)
    records["orientation.w"] = 1.0
    records["orientation_covariance"][:, 0] = NO_ESTIMATE
    records["angular_velocity"], records["linear_acceleration"] = gyro, accel
    missing = np.where(valid, 0.0, NO_ESTIMATE)
    records["angular_velocity_covariance"][:, 0] = records["linear_acceleration_covariance"][:, 0] = missing
    return layout.cut(records)


def encode_temperatures(stamps: ArrayLike, degc: ArrayLike) -> list[bytes]:
    """Return temperatures inside the instrument's case as sensor_msgs/Temperature."""
    records = _stamped(TEMPERATURE, stamps, header__frame_id="imu_case")
    records["temperature"] = degc
    return layout.cut(records)


def encode_table_references(stamps: ArrayLike, kind: str, angles_deg: ArrayLike, rates_dps: ArrayLike) -> list[bytes]:
    """Return known angles (deg) and rates (deg/s) of the table, NaN where unknown, as imutui_msgs/TableReference."""
    records = _stamped(REFERENCE, stamps, header__frame_id="table", kind=kind)
    records["angles_deg"], records["rates_dps"] = angles_deg, rates_dps
    return layout.cut(records)


def encode_table_state(
    stamp_ns: int, uncertainty_ns: int, angles_deg: ArrayLike, rates_dps: ArrayLike, mode: str, fault: str
) -> bytes:
    """Return one report of the table's controller, angles (deg) and rates (deg/s), as imutui_msgs/TableState."""
    records = _stamped(STATE, stamp_ns, header__frame_id="table", mode=mode, fault=fault)
    records["angles_deg"], records["rates_dps"], records["uncertainty_ns"] = angles_deg, rates_dps, uncertainty_ns
    return records.tobytes()


def encode_estimates(stamps: ArrayLike, numbers: np.ndarray, dofs: ArrayLike, converged: ArrayLike) -> list[bytes]:
    """Return states of the filter as imutui_msgs/Estimate.

    `numbers`: its 31 numbers in the order of the definition, shape (N, 31).
    `dofs`: degrees of freedom of the NIS.
    `converged`: of six biases.
    """
    records = _stamped(ESTIMATE, stamps, header__frame_id=_IMU_FRAME)
    # the numbers lie side by side
    first = records.dtype.fields["position_deg_m"][1]  # type: ignore[index]
    data = records.view(np.uint8).reshape(records.size, -1)
    data[:, first : first + 8 * numbers.shape[1]] = np.ascontiguousarray(numbers, "<f8").view(np.uint8)
    records["nis_dof"], records["converged"] = dofs, converged
    return layout.cut(records)


def _time(ns: int) -> dict[str, int]:
    return {"sec": ns // _SECOND, "nanosec": ns % _SECOND}


def encode_transforms(stamp_ns: int) -> bytes:
    """Return tf2_msgs/TFMessage from `imu_link` (x forward, y left, z up) to the samples' frame."""
    half_turn = {  # about x
        "header": {"stamp": _time(stamp_ns), "frame_id": _IMU_LINK},
        "child_frame_id": _IMU_FRAME,
        "transform": {"rotation": {"x": 1.0}},
    }
    return layout.encode(TYPES[TRANSFORMS], {"transforms": [half_turn]})


def encode_diagnostics(stamp_ns: int, level: int, message: str, values: dict[str, str]) -> bytes:
    """Return diagnostic_msgs/DiagnosticArray with one status; level 0 ok, 1 warning, 2 error."""
    status = {
        "level": level,
        "name": "imutui: acquisition",
        "message": message,
        "hardware_id": values.get("serial_number", ""),
        "values": [{"key": key, "value": value} for key, value in values.items()],
    }
    return layout.encode(TYPES[DIAGNOSTICS], {"header": {"stamp": _time(stamp_ns)}, "status": [status]})


def encode_event(stamp_ns: int, name: str, text: str, level: int = 20) -> bytes:
    """Return rcl_interfaces/Log; level 20 info, 30 warn, 40 error.

    `name`: "mark" for the operator's, "acquisition" for the program's, "remark" for an operator's text while a profile
      guides him, which begins no segment as a mark would.
    """
    return layout.encode(TYPES[EVENTS], {"stamp": _time(stamp_ns), "level": level, "name": name, "msg": text})


# -------------------------------------------------------------------------------------------------------------- reading


@dataclass(frozen=True, slots=True)
class LogEvent:
    """A mark of the operator or an event of the program."""

    stamp_ns: int
    name: str
    text: str


def decode_event(data: bytes) -> LogEvent:
    """Return the event in the CDR bytes of rcl_interfaces/Log. Raises UndecodableError if they are none."""
    found = layout.decode(TYPES[EVENTS], data)
    stamp_ns = int(found["stamp.sec"]) * _SECOND + int(found["stamp.nanosec"])
    return LogEvent(stamp_ns, layout.text(found, "name"), layout.text(found, "msg"))


def decode_diagnostics(data: bytes) -> dict[str, str] | None:
    """Return the values of the first status in diagnostic_msgs/DiagnosticArray, None if there is no status.

    Raises UndecodableError if the bytes are no such message.
    """
    found = layout.decode(TYPES[DIAGNOSTICS], data)
    if not found["status" + layout.SIZE]:
        return None
    pairs = (f"status[0].values[{k}]." for k in range(found["status[0].values" + layout.SIZE]))
    return {layout.text(found, pair + "key"): layout.text(found, pair + "value") for pair in pairs}
