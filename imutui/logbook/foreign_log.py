"""Logs of other programs: which of their messages are samples, in what order, and how they are meant.

A survey looks at every sample once, in bounded memory. A plan follows from it and from what the caller states; it says
in words what it assumes, or refuses the log with commands that work. Samples are then read by the plan.
"""

import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from mcap.records import Channel, McapRecord, Metadata, Schema

from filters.errors import InputError
from filters.imu import STANDARD_GRAVITY, AxisMap
from imutui.logbook import arrival_stamps, columns, schemas
from imutui.logbook.mcap_stream import CHANNEL, Batch
from imutui.logbook.reading import Reading
from imutui.logbook.session_info import METADATA

Records = Callable[[], Iterable[McapRecord | Batch]]
"""Returns the records of a file in order, anew by each call."""
Cure = tuple[str, tuple[str, ...]]
"""A command and its flags; the command "" stands for the one that was given."""
Rows = dict[str, np.ndarray]
"""Columns of samples by their names in `Samples`, with temperatures as `degc_stamp_ns` and `degc`."""

_IMU, _TEMPERATURE = (schemas.TYPES[topic].replace("/msg/", "/") for topic in (schemas.IMU, schemas.TEMPERATURE))
_FEW = 0.01
"""Largest share of samples with the stamp of the one before them that are dropped without being asked."""
_STILL, _NOISY_DPS = 0.05, 1.0
_EARLIEST_NS = 946_684_800_000_000_000  # 2000: an earlier stamp is no UTC
_MOST_LISTED = 6
_FEWEST = 100  # samples of which a mean is compared
NEAR = 256  # samples of one clock that are out of order lie at most so many from their place
_SILENCE_NS = 1_000_000_000  # a longer step is a gap
_STEADY = int(8 * np.log2(1.1 * _SILENCE_NS))  # steps of fewer eighths of octaves are no gaps


class RefusedLogError(InputError):
    """A log that can be taken in more than one way, or not as it is.

    `cures`: commands that take the log.
    """

    def __init__(self, message: str, cures: Sequence[Cure] = ()) -> None:
        super().__init__(message)
        self.cures = tuple(cures)


# -------------------------------------------------------------------------------------------------------------- survey


@dataclass(slots=True)
class Order:
    """How instants follow each other, ns."""

    first: int = 0
    least: int = 0
    last: int = 0
    count: int = 0
    equal: int = 0  # instants that are the one before
    back: int = 0  # instants before the one before
    before_back: int = 0  # the instant before the first that goes back
    after_back: int = 0  # the first that goes back
    # number and sum of the steps forward, by eighths of octaves; and the longest of at most a second
    steps: np.ndarray = field(default_factory=lambda: np.zeros(64 * 8, int))
    lengths: np.ndarray = field(default_factory=lambda: np.zeros(64 * 8))
    longest: int = 0

    def take(self, instants: np.ndarray) -> None:
        """Take more instants, shape (n,), n > 0."""
        steps = np.diff(instants, prepend=self.last) if self.count else np.diff(instants)
        forward = steps[steps > 0]
        which = (8 * np.log2(forward)).astype(int)
        np.add.at(self.steps, which, 1)
        np.add.at(self.lengths, which, forward)
        self.longest = max(self.longest, int(forward[forward <= _SILENCE_NS].max(initial=0)))
        back = np.flatnonzero(steps < 0)
        if back.size and not self.back:
            at = int(back[0]) + instants.size - steps.size
            self.before_back = int(instants[at - 1]) if at else self.last
            self.after_back = int(instants[at])
        self.equal += int(np.count_nonzero(steps == 0))
        self.back += int(back.size)
        self.first = self.first if self.count else int(instants[0])
        self.least = min(self.least, int(instants.min())) if self.count else int(instants.min())
        self.last, self.count = int(instants[-1]), self.count + instants.size

    @property
    def period_ns(self) -> float:
        """Usual step, ns: the mean of those near the median, which gaps and lost samples do not lengthen.

        Of arrivals in bursts it is the mean of the steps of at most a second. 0 if no step goes forward.
        """
        if not self.steps.any():
            return 0.0
        median = int(np.searchsorted(np.cumsum(self.steps), 0.5 * self.steps.sum()))
        usual = slice(max(0, median - 8), median + 7) if not self.bursts() else slice(0, _STEADY)
        return float(self.lengths[usual].sum() / self.steps[usual].sum())

    def bursts(self) -> str:
        """Return what makes the instants look like arrivals in bursts, "" if they do not."""
        count = int(self.steps[:_STEADY].sum())
        period = float(self.lengths[:_STEADY].sum()) / max(count, 1)
        short = 2.0 ** (np.arange(1, 64 * 8 + 1) / 8) < arrival_stamps.SHORT * period
        return arrival_stamps.burst_words(self.steps[short].sum() / max(count, 1), period / 1e9, self.longest / 1e9)


@dataclass(slots=True)
class Topic:
    """The samples of a topic, whichever channels it has."""

    name: str
    channels: dict[int, "Topic"] = field(default_factory=dict)  # of the file; of several, what each holds
    stamps: Order = field(default_factory=Order)
    logged: Order = field(default_factory=Order)
    undecodable: int = 0  # messages that are none of their type
    repeated: int = 0  # samples that repeat the one before, with its stamp
    zero: int = 0  # samples whose six readings are zero
    # samples with a reading that is no number, by where: neither, the rates, the forces, both
    no_number: np.ndarray = field(default_factory=lambda: np.zeros(4, int))
    has: np.ndarray = field(default_factory=lambda: np.zeros(2, bool))  # rates and forces that are no zeros
    unknown: np.ndarray = field(default_factory=lambda: np.zeros(2, int))  # gyro and accel stated as "no estimate"
    # over samples that are six numbers and not all zero: count, sums, sums of squares
    used: int = 0
    sum: np.ndarray = field(default_factory=lambda: np.zeros(6))
    squares: np.ndarray = field(default_factory=lambda: np.zeros(6))
    changes: list[np.ndarray] = field(default_factory=list)  # median change from sample to sample, of each batch
    before: np.ndarray | None = None  # the last sample

    def take(self, rows: np.ndarray, log_ns: np.ndarray) -> None:
        """Take samples, records of `columns.DTYPES[columns.IMU]`, and their log times."""
        self.stamps.take(rows["stamp_ns"])
        self.logged.take(log_ns)
        for k, name in enumerate(("gyro_covariance", "accel_covariance")):
            self.unknown[k] += np.count_nonzero(rows[name] == schemas.NO_ESTIMATE)
        readings = np.hstack([rows["gyro"], rows["accel"]])
        seven = np.column_stack([rows["stamp_ns"].view(float), readings])  # only compared
        seven = seven if self.before is None else np.vstack([self.before, seven])
        self.repeated += int(np.count_nonzero(((seven[1:] == seven[:-1]) | np.isnan(seven[1:])).all(axis=1)))
        self.before = seven[-1:]
        finite = np.isfinite(readings).reshape(-1, 2, 3).all(axis=2)
        self.no_number += np.bincount(~finite @ [1, 2], minlength=4)
        self.has |= (finite & readings.reshape(-1, 2, 3).any(axis=2)).any(axis=0)
        readings[~np.repeat(finite, 3, axis=1)] = 0.0
        known = readings.any(axis=1)
        self.zero += int(np.count_nonzero(~known & finite.all(axis=1)))
        readings = readings[known & finite[:, self.has].all(axis=1)]
        self.used += len(readings)
        with np.errstate(over="ignore", invalid="ignore"):  # of numbers that are no readings
            self.sum += readings.sum(axis=0)
            self.squares += (readings**2).sum(axis=0)
            if len(readings) > 1:
                self.changes.append(np.median(np.abs(np.diff(readings, axis=0)), axis=0))

    @property
    def missing(self) -> int:
        """Number of samples that lack a reading of what the others have."""
        lacks = ~self.has @ [1, 2]
        return int(self.no_number[np.arange(4) & ~lacks > 0].sum())

    @property
    def count(self) -> int:
        """Number of samples."""
        return self.stamps.count

    @property
    def mean(self) -> np.ndarray:
        """Mean angular rate and specific force, as they stand in the file, shape (6,)."""
        return self.sum / max(self.used, 1)

    def noise(self) -> np.ndarray:
        """Standard deviation of each channel by the changes from sample to sample, shape (6,)."""
        return np.asarray(np.median(self.changes or [np.zeros(6)], axis=0) / 0.954)

    def is_mixed(self) -> bool:
        """Return whether channels that go on at the same time read what one unit cannot read."""
        each = [channel for channel in self.channels.values() if channel.used >= _FEWEST]
        for a, b in itertools.combinations(each, 2):
            both = min(a.logged.last, b.logged.last) - max(a.logged.first, b.logged.first)
            shorter = min(c.logged.last - c.logged.first for c in (a, b))
            if both > 0.5 * shorter and (np.abs(a.mean - b.mean) > np.maximum(a.noise(), b.noise())).any():
                return True
        return False

    def is_still(self) -> bool:
        """Return whether the specific force keeps its direction and size."""
        with np.errstate(over="ignore", invalid="ignore"):
            spread = np.sqrt(np.maximum(self.squares / max(self.used, 1) - self.mean**2, 0.0))[3:]
        return bool(self.used and spread.max() < _STILL * np.linalg.norm(self.mean[3:]))


@dataclass(slots=True)
class Survey:
    """What another program's file holds."""

    samples: dict[str, Topic] = field(default_factory=dict)  # topics of sensor_msgs/Imu in CDR that have messages
    temperatures: dict[str, int] = field(default_factory=dict)  # messages of topics of sensor_msgs/Temperature
    others: dict[str, str] = field(default_factory=dict)  # any other topic: encoding and type


def survey(records: Iterable[McapRecord | Batch]) -> Survey | None:
    """Look at every sample of a file; returns None for a log of imutui."""
    found, types, roles = Survey(), dict[int, str](), dict[int, tuple[str, int]]()
    for record in records:
        match record:
            case Schema():
                types[record.id] = record.name.replace("/msg/", "/")
            case Channel():
                kind = types.get(record.schema_id, "")
                role = _role(record, kind)
                roles[record.id] = (record.topic, role)
                if role == columns.IGNORED:
                    found.others[record.topic] = f"{record.message_encoding or 'no encoding'}, {kind or 'no type'}"
            case Metadata() if record.name == METADATA:
                return None
            case Batch():
                for topic, role, part in _by_channel(record, roles):
                    if role == columns.TEMPERATURE:
                        found.temperatures[topic] = found.temperatures.get(topic, 0) + len(part.table)
                        continue
                    rows, bad = columns.read(part, np.full(len(part.table), role))
                    good = np.ones(len(part.table), bool)
                    good[list(bad)] = False
                    if bad:
                        found.samples.setdefault(topic, Topic(topic)).undecodable += len(bad)
                    if good.any():
                        seen = found.samples.setdefault(topic, Topic(topic))
                        own = seen.channels.setdefault(int(part.table[0, CHANNEL]), Topic(topic))
                        seen.take(rows[role], part.heads["log_ns"][good])
                        if sum(each == (topic, role) for each in roles.values()) > 1:
                            own.take(rows[role], part.heads["log_ns"][good])
    for name in [name for name, topic in found.samples.items() if not topic.count]:
        del found.samples[name]
        found.others[name] = f"cdr that cannot be decoded, {_IMU}"
    return found


def _role(channel: Channel, kind: str) -> int:
    if channel.message_encoding != "cdr":
        return columns.IGNORED
    return {_IMU: columns.IMU, _TEMPERATURE: columns.TEMPERATURE}.get(kind, columns.IGNORED)


def _by_channel(batch: Batch, roles: dict[int, tuple[str, int]]) -> Iterator[tuple[str, int, Batch]]:
    """Yield topic, role and messages of each channel in a batch that has a role."""
    channels = batch.table[:, CHANNEL]
    for number in np.unique(channels).tolist():
        topic, role = roles.get(number, ("", columns.IGNORED))
        if role != columns.IGNORED:
            yield topic, role, Batch(batch.content, batch.table[channels == number])


# ---------------------------------------------------------------------------------------------------------------- plan


@dataclass(frozen=True, slots=True)
class Plan:
    """How the samples of a file are read."""

    gyro: Topic
    accel: Topic  # the same topic, but where two are joined
    temperature: str | None  # topic of temperatures
    stamps: str  # one of `reading.STAMPS`
    at_once: bool  # whether samples have to be put into order, which takes all of them
    unknown_counts: tuple[bool, bool]  # whether "no estimate" of rates and of forces means no reading
    mends: bool  # whether the caller leaves out samples that repeat
    assumed: tuple[str, ...]  # in words
    period_ns: float  # usual step of the samples in their order; 0 if there is none

    @property
    def mean_force(self) -> np.ndarray:
        """Mean specific force as it stands in the file, m/s², shape (3,)."""
        return self.accel.mean[3:]

    @property
    def first_ns(self) -> int:
        """The instant from which seconds of the log count, ns."""
        order = self.gyro.stamps if self.stamps == "header" else self.gyro.logged
        return order.least if self.at_once else order.first


def plan(found: Survey, reading: Reading, records: Records, *, mends: bool = False) -> Plan:
    """Decide how samples are read.

    `records`: of the file, which is looked at again where log times go back.
    `mends`: the caller looks at the units, and makes a clock that was set back go on.

    Raises RefusedLogError if the caller has to choose, or the numbers are not in SI.
    """
    gyro, accel = _chosen(found, reading.topics)
    assumed = [f"samples of {gyro.name}" + (f" with the forces of {accel.name}" if accel is not gyro else "")]
    if accel is not gyro:
        assumed.append("forces are interpolated at the instants of the rates")
        if not (gyro.has[0] and accel.has[1]):
            name, what = (accel.name, "forces") if gyro.has[0] else (gyro.name, "rates")
            raise RefusedLogError(f"its topic {name} has no {what}", _choices(found))
    instants = _sorted_instants(records, gyro) if gyro.logged.back else None
    sortable = not gyro.logged.back or instants is not None
    stamps, more = _stamps(gyro, reading, sortable=sortable, mends=mends)
    assumed += more
    if accel is not gyro:
        rates, forces = (t.stamps if stamps == "header" else t.logged for t in (gyro, accel))
        early, late = (max(0, ns) / 1e9 for ns in (forces.first - rates.first, rates.last - forces.last))
        if early or late:
            assumed.append(f"rates without forces are left out, of the first {early:.3f} s and the last {late:.3f} s")
        if gaps := int(forces.steps[_STEADY:].sum()):
            assumed.append(f"rates in gaps of the forces hold no reading: {gaps:,} gap(s)")
    if not mends:
        _refuse_units(gyro, accel)
        if gyro.is_mixed():
            what = f"its topic {gyro.name} holds samples of several units, each on a channel of its own"
            raise RefusedLogError(what, [("import", ("--topic", gyro.name, "--accel-sign", "+1"))])
    unknown = [bool(0 < topic.unknown[k] < topic.count) for k, topic in enumerate((gyro, accel))]
    if any(topic.unknown[k] == topic.count for k, topic in enumerate((gyro, accel))):
        assumed.append("a covariance of -1 in every message stands for an unknown covariance, not for no reading")
    for k, topic in enumerate((gyro, accel)):
        if unknown[k]:
            assumed.append(f"{_samples(int(topic.unknown[k]))} with a covariance of -1 hold no reading")
    if gyro.undecodable:
        assumed.append(f"messages that cannot be decoded are left out: {gyro.undecodable:,}")
    if gyro.missing:
        assumed.append(f"{_samples(gyro.missing)} with NaN hold no reading")
    if accel is gyro and gyro.zero:
        assumed.append(f"{_samples(gyro.zero)} of six zeros hold no reading")
    temperature = _temperature(found, gyro.name)
    if temperature is not None:
        assumed.append(f"temperatures of {temperature}")
    elif found.temperatures:
        assumed.append(f"none of the temperature topics ({', '.join(sorted(found.temperatures))})")
    order = gyro.stamps if stamps == "header" else gyro.logged
    if instants is not None:
        order = Order()
        order.take(instants)
    at_once = accel is not gyro or stamps == "arrival" or (gyro.logged.back > 0 and sortable)
    return Plan(
        gyro, accel, temperature, stamps, at_once, (unknown[0], unknown[1]), mends, tuple(assumed), order.period_ns
    )


def _samples(count: int) -> str:
    return f"{count:,} sample{'' if count == 1 else 's'}"


def _chosen(found: Survey, wanted: tuple[str, ...]) -> tuple[Topic, Topic]:
    """Return the topics of rates and of forces."""
    for name in wanted:
        if name not in found.samples:
            listed = ", ".join(sorted(found.samples)) or "none"
            raise RefusedLogError(f"it has no samples on topic {name}; topics of samples: {listed}", _choices(found))
    if wanted:
        return found.samples[wanted[0]], found.samples[wanted[-1]]
    if len(found.samples) > 1:
        listed = ", ".join(f"{topic.name} ({topic.count:,})" for topic in found.samples.values())
        raise RefusedLogError(
            f"it has several topics of samples, of which one is to be chosen: {listed}", _choices(found)
        )
    (only,) = found.samples.values()
    return only, only


def _choices(found: Survey) -> Sequence[Cure]:
    """Return the flags of each choice: first a pair of topics that lack each other's channels."""
    lacks = {name: tuple((~topic.has).tolist()) for name, topic in found.samples.items()}
    gyros = [name for name, lacking in lacks.items() if lacking == (False, True)]
    accels = [name for name, lacking in lacks.items() if lacking == (True, False)]
    pairs = [f"{a},{b}" for a in gyros for b in accels]
    whole = [name for name, lacking in lacks.items() if not any(lacking)]
    return [("", ("--topic", name)) for name in (*pairs, *whole, *([] if pairs else (*gyros, *accels)))][:_MOST_LISTED]


def _temperature(found: Survey, samples: str) -> str | None:
    """Return the topic of temperatures: the only one, or the only one below the samples' namespace."""
    names = [name for name, count in found.temperatures.items() if count]
    near = [name for name in names if name.rpartition("/")[0] == samples.rpartition("/")[0]]
    return names[0] if len(names) == 1 else near[0] if len(near) == 1 else None


def _sorted_instants(records: Records, topic: Topic) -> np.ndarray | None:
    """Return the log times in order, None if the samples may not be put into it."""
    types, roles, parts = dict[int, str](), dict[int, tuple[str, int]](), list[np.ndarray]()
    for record in records():
        match record:
            case Schema():
                types[record.id] = record.name.replace("/msg/", "/")
            case Channel() if record.topic == topic.name:
                roles[record.id] = (topic.name, _role(record, types.get(record.schema_id, "")))
            case Batch():
                parts += [part.heads["log_ns"] for _, _, part in _by_channel(record, roles)]
    instants = np.concatenate(parts)
    moved = np.abs(np.argsort(instants, kind="stable") - np.arange(instants.size))
    # one channel is written by one clock; several come of files that were merged
    is_sortable = (len(topic.channels) > 1 or int(moved.max()) <= NEAR) and is_orderly(instants)
    return np.sort(instants) if is_sortable else None


def is_orderly(instants: np.ndarray) -> bool:
    """Return whether instants that go back now and then follow each other evenly once they are sorted.

    Those that were written out of order do. Those of a clock that was set back come to lie between each other.
    """
    steps, sorted_steps = np.diff(instants), np.diff(np.sort(instants))
    half = 0.5 * np.median(sorted_steps)
    short = np.count_nonzero((steps >= 0) & (steps < half))
    return bool(np.count_nonzero(sorted_steps < half) - short <= 0.2 * np.count_nonzero(steps < 0))


def _stamps(topic: Topic, reading: Reading, *, sortable: bool, mends: bool) -> tuple[str, list[str]]:
    """Return the source of the stamps, and what is assumed of them."""
    order, logged, assumed = topic.stamps, topic.logged, list[str]()
    if reading.stamps == "arrival":
        return "arrival", ["stamps are sampling instants fitted under the log times"]
    whole = reading.start is None and reading.end is None and not mends
    if topic.repeated and not mends:
        assumed.append(f"{_samples(topic.repeated)} that repeat the one before are dropped")
    if reading.stamps == "log":
        if whole and not sortable:
            raise RefusedLogError(*_broken(topic, logged))
        if logged.back and sortable:
            assumed.append("samples are put into the order of their log times")
        assumed.append("stamps are the log times")
        if logged.equal > topic.repeated and not mends:
            assumed.append(f"{_samples(logged.equal - topic.repeated)} with the log time of the one before are dropped")
        return "log", assumed
    equal = order.equal - topic.repeated
    if equal > _FEW * topic.count:
        what = f"{_samples(equal)} of {topic.name} have the stamp of the one before: its stamps stand still"
        cures: list[Cure] = [("", ("--stamps", "log"))] if logged.equal - topic.repeated <= _FEW * topic.count else []
        raise RefusedLogError(what, [*cures, ("", ("--stamps", "arrival"))] if logged.last > logged.first else [])
    if logged.back and sortable:
        assumed.append("samples are put into the order of their log times")
    elif order.back and whole:
        raise RefusedLogError(*_broken(topic, order))
    if equal > 0 and not mends:
        assumed.append(f"{_samples(equal)} with the stamp of the one before are dropped")
    if 0 <= order.first < _EARLIEST_NS <= logged.first:
        assumed.append("stamps count from another instant than UTC's")
    if (words := order.bursts()) and not mends:
        assumed.append(f"stamps look like arrivals in bursts ({words}); --stamps arrival fits the sampling instants")
    return "header", assumed


def _broken(topic: Topic, order: Order) -> tuple[str, Sequence[Cure]]:
    at, by = (order.before_back - order.first) / 1e9, (order.before_back - order.after_back) / 1e9
    places = "once" if order.back == 1 else f"{order.back} times"
    what = f"the times of {topic.name} go back {places}, first by {by:.6g} s at {at:.3f} s"
    end = (order.after_back - order.first) / 1e9
    cures: list[Cure] = [("", ("--stamps", "log"))] if not topic.logged.back else []
    cures.append(("import", ("--topic", topic.name, "--accel-sign", "+1")))
    cures += [("", ("--end", f"{at - 1e-3:.3f}"))] if at > 1.0 else []
    begins_once = order.back == 1 and (order.last - order.first) / 1e9 > max(at, end) + 1.0
    cures += [("", ("--start", f"{at + 1e-3:.3f}"))] if begins_once else []
    return what, cures


# ------------------------------------------------------------------------------------------------- units and directions


_FORCE_UNITS = (("g", "g", 1.0), ("mg", "mg", 1000.0), ("mm/s^2", "m/s2/1000", 1e3 * STANDARD_GRAVITY))
"""Units of force that are not m/s^2: name, name in flags, and gravity in them."""


def _refuse_units(gyro: Topic, accel: Topic) -> None:
    """Raise RefusedLogError where a unit at rest reads what it reads in g or in deg/s."""
    if not accel.is_still():
        return
    force = float(np.linalg.norm(accel.mean[3:]))
    units = [(name, f"accel:{flag}") for name, flag, size in _FORCE_UNITS if 0.8 < force / size < 1.2]
    noise = float(np.median(gyro.noise()[:3]))
    if np.rad2deg(noise) > _NOISY_DPS:
        name = "deg/s" if noise < 3.0 * _NOISY_DPS else "mdeg/s"
        units.append((name, f"gyro:{name}"))
    if not units:
        return
    topics = gyro.name if accel is gyro else f"{gyro.name},{accel.name}"
    flags = ["--topic", topics, "--units", ",".join(flag for _, flag in units), "--accel-sign", "+1"]
    if accel.mean[5] > 0.5 * force:
        flags += ["--mount", "x,-y,-z"]
    elif abs(accel.mean[5]) <= 0.5 * force:
        flags += ["--reference", "gravity"]
    read = f"at rest it reads a force of {force:.4g} and rates that scatter by {noise:.2g}"
    what = f"{read}, which fits {' and '.join(name for name, _ in units)}, not m/s^2 and rad/s"
    raise RefusedLogError(what, [("import", tuple(flags))])


def refuse_upside_down(path: Path, force: np.ndarray, axes: AxisMap, gravity: float) -> None:
    """Raise RefusedLogError where the mean force of a unit that is said to be level points down or sideways.

    `force`: as it stands in the file, m/s², shape (3,).
    `axes`: instrument to body.
    """
    body = axes.accel_to_body(force)
    size = float(np.linalg.norm(force))
    if abs(size / gravity - 1.0) > 0.2 or body[2] < -0.5 * gravity:
        return
    reads = ", ".join(f"{value:+.2f}" for value in force)
    what = (
        f"{path}: a unit that is level reads -{gravity:.2f} m/s^2 along z down, and this one reads {reads} on x, y, z"
    )
    turned = np.diag([1.0, -1.0, -1.0]) @ axes.mount
    mount = ",".join("-" * bool(row.min() < -0.5) + "xyz"[int(np.argmax(np.abs(row)))] for row in turned)
    level: list[Cure] = [("", ("--mount", mount)), ("", ("--accel-sign", f"{-axes.accel_sign:+d}"))]
    other: list[Cure] = [("", ("--reference", "gravity"))]
    if body[2] > 0.5 * gravity:
        raise RefusedLogError(
            f"{what}: its z is up (as ROS has it: x forward, y left), or its sign is the other", level + other
        )
    raise RefusedLogError(f"{what}: it is not level", other)


# ------------------------------------------------------------------------------------------------------------- samples


def samples(records: Records, wanted: Plan, reading: Reading, axes: AxisMap) -> Iterator[Rows]:
    """Yield the samples of a file by a plan, a bounded number at a time unless they have to be put into order.

    `reading`: its part counts, s since the log's first sample.
    `axes`: from the file's axes and sign to the body's.
    """
    last_ns, part = np.iinfo(np.int64).min, _Part(reading, wanted.first_ns)
    stream: Iterable[Rows] = _read(records, wanted)
    if wanted.at_once:
        stream = [_in_order(list(stream), wanted)]
    for found in stream:
        stamps = found["stamp_ns"]
        new = part.has(stamps)
        if not wanted.mends:
            new &= np.diff(stamps, prepend=last_ns) != 0 if stamps.size else np.empty(0, bool)
        last_ns = int(stamps[-1]) if stamps.size else last_ns
        gyro, accel = found["gyro"][new], found["accel"][new]
        yield {
            "stamp_ns": stamps[new],
            "gyro": axes.gyro_to_body(gyro),
            "accel": axes.accel_to_body(accel),
            "valid": found["valid"][new],
            "degc_stamp_ns": found["degc_stamp_ns"],
            "degc": found["degc"],
        }


class _Part:
    """The samples in a row from the last one before `start` to the first one behind `end`."""

    def __init__(self, reading: Reading, first: int) -> None:
        bounds = np.iinfo(np.int64)
        self._start = bounds.min if reading.start is None else first + round(reading.start * 1e9)
        self._end = bounds.max if reading.end is None else first + round(reading.end * 1e9)
        self._begun = self._over = False

    def has(self, stamps: np.ndarray) -> np.ndarray:
        """Return which of the next samples are in the part, bool, shape (n,)."""
        use = np.zeros(stamps.size, bool)
        if self._over or not stamps.size:
            return use
        begin = 0
        if not self._begun:
            early = np.flatnonzero(stamps < self._start)
            begin = int(early[-1]) + 1 if early.size else 0
            self._begun = begin < stamps.size
        late = np.flatnonzero(stamps[begin:] > self._end)
        end = begin + int(late[0]) if late.size else stamps.size
        self._over = bool(late.size)
        use[begin:end] = True
        return use


def _read(records: Records, wanted: Plan) -> Iterator[Rows]:
    """Yield the samples of the plan's topics in file order; those of two topics carry the one they are of."""
    types, roles, one = dict[int, str](), dict[int, tuple[str, int]](), wanted.gyro is wanted.accel
    names = {wanted.gyro.name, wanted.accel.name, wanted.temperature}
    for record in records():
        match record:
            case Schema():
                types[record.id] = record.name.replace("/msg/", "/")
            case Channel() if record.topic in names:
                roles[record.id] = (record.topic, _role(record, types.get(record.schema_id, "")))
            case Batch():
                parts = list(_by_channel(record, roles))
                if one and len(parts) > 1:  # channels of one topic go on in file order
                    parts = _merged(record, roles)
                found = [_columns(topic, role, part, wanted) for topic, role, part in parts]
                yield from found


def _merged(batch: Batch, roles: dict[int, tuple[str, int]]) -> list[tuple[str, int, Batch]]:
    channels = batch.table[:, CHANNEL]
    each = np.array([roles.get(number, ("", columns.IGNORED))[1] for number in range(int(channels.max()) + 1)])
    topics = {role: topic for topic, role in roles.values()}
    of = each[channels]
    kinds = [role for role in np.unique(of).tolist() if role != columns.IGNORED]
    return [(topics[role], role, Batch(batch.content, batch.table[of == role])) for role in kinds]


def _columns(topic: str, role: int, part: Batch, wanted: Plan) -> Rows:
    found, bad = columns.read(part, np.full(len(part.table), role))
    good = np.ones(len(part.table), bool)
    good[list(bad)] = False
    rows, log_ns = found[role], part.heads["log_ns"][good]
    nothing = {"stamp_ns": np.empty(0, np.int64), "gyro": np.empty((0, 3)), "accel": np.empty((0, 3)),
               "valid": np.empty(0, bool), "log_ns": np.empty(0, np.int64), "degc_stamp_ns": np.empty(0, np.int64),
               "degc": np.empty(0), "forces": np.empty(0, bool)}  # fmt: skip
    if role == columns.TEMPERATURE:
        stamps = rows["stamp_ns"] if wanted.stamps == "header" else log_ns
        return nothing | {"degc_stamp_ns": stamps.copy(), "degc": rows["degc"].copy()}
    gyro, accel = rows["gyro"].copy(), rows["accel"].copy()
    # of a pair of topics each gives what it is asked for, whatever stands for the rest
    valid = np.isfinite(gyro).all(axis=1) | (topic != wanted.gyro.name)
    valid &= np.isfinite(accel).all(axis=1) | (topic != wanted.accel.name)
    if wanted.gyro is wanted.accel:
        valid &= (gyro != 0.0).any(axis=1) | (accel != 0.0).any(axis=1)
    for counts, name in zip(wanted.unknown_counts, ("gyro_covariance", "accel_covariance"), strict=True):
        valid &= ~(counts & (rows[name] == schemas.NO_ESTIMATE))
    # a sample without a reading is no number anywhere
    gyro[~valid], accel[~valid] = np.nan_to_num(gyro[~valid]), np.nan_to_num(accel[~valid])
    stamps = rows["stamp_ns"].copy() if wanted.stamps == "header" else log_ns.copy()
    return nothing | {"stamp_ns": stamps, "gyro": gyro, "accel": accel, "valid": valid, "log_ns": log_ns,
                      "forces": np.full(stamps.size, topic == wanted.accel.name)}  # fmt: skip


def _in_order(parts: list[Rows], wanted: Plan) -> Rows:
    """Return all samples in order: of their log times, joined where two topics are, at instants fitted if asked."""
    names = parts[0] if parts else ()
    whole = {name: np.concatenate([part[name] for part in parts]) for name in names}
    order = np.argsort(whole["log_ns"], kind="stable")
    for name in ("stamp_ns", "gyro", "accel", "valid", "forces", "log_ns"):
        whole[name] = whole[name][order]
    if wanted.gyro is not wanted.accel:
        whole = _joined(whole)
    if wanted.stamps == "arrival":
        first = int(whole["stamp_ns"][0])
        t = (whole["stamp_ns"] - first) / 1e9
        new = np.diff(t, prepend=-1.0) >= 0.0
        for name in ("stamp_ns", "gyro", "accel", "valid"):
            whole[name] = whole[name][new]
        whole["stamp_ns"] = first + np.round(arrival_stamps.from_arrivals(t[new]).t * 1e9).astype(np.int64)
    return whole


def _joined(whole: Rows) -> Rows:
    """Return samples at the instants of the rates, with the forces of the other topic by straight lines."""
    forces = whole["forces"]
    own, other = (
        {name: whole[name][which] for name in ("stamp_ns", "gyro", "accel", "valid")} for which in (~forces, forces)
    )
    order = np.argsort(other["stamp_ns"], kind="stable")
    at, known = other["stamp_ns"][order][other["valid"][order]], other["accel"][order][other["valid"][order]]
    own["accel"] = np.column_stack([np.interp(own["stamp_ns"], at, known[:, k]) for k in range(3)])
    inside = (own["stamp_ns"] >= at[0]) & (own["stamp_ns"] <= at[-1])
    behind = np.clip(np.searchsorted(at, own["stamp_ns"]), 1, at.size - 1)
    own["valid"] &= at[behind] - at[behind - 1] <= _SILENCE_NS
    own = {name: column[inside] for name, column in own.items()}
    return whole | own
