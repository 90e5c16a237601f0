"""Whether logs belong together, and whether a run follows its reference at all.

What is refused here is a mistake in the input, with the cure in the message: another sign, other angles, another time,
another unit. What is left is small enough to be an error of the sensors, which is the tracer's subject. The limits are
an order of magnitude beyond what the catalogue of effects calls plausible.
"""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from filters.errors import InputError
from filters.imu import STANDARD_GRAVITY, format_mount
from filters.tracing.blocks import BLOCK_S, average
from filters.tracing.long_run import ROWS_A_BLOCK
from filters.tracing.validation import HOLD_S
from filters.types import Array
from imutui.jobs.runs import LoggedRun

_STEP = 0.05
_SAME = 1e-9
_MOVING = np.deg2rad(1.0)
_AT_REST = np.deg2rad(0.05)
_DIRECTION = np.deg2rad(6.0)
_NORM = 0.05
_LEAST = 0.4
_SHIFT = 0.1
_LONGEST_SHIFT = 120.0
_TURNS_DPS = 5.0
_SWAYS = 0.05 * STANDARD_GRAVITY
# between the 10 % and the 90 % quantile, in standard deviations
_QUANTILES = 2.563
_JUDGED_S = 300.0
_THERMAL_K = 0.5


# ------------------------------------------------------------------------------------------- logs beside one another


def check_together(reads: Sequence[LoggedRun]) -> None:
    """Refuse logs that cannot be runs of one campaign.

    Raises InputError if one stands there twice, or two are of different units, mountings, signs, sites, or kinds.
    """
    _check_copies(reads)
    first = reads[0]
    for other in reads[1:]:
        a, b = first.info, other.info
        where = f"{first.path} and {other.path}"
        for what, one, two in (
            ("instrument", a.instrument, b.instrument),
            ("serial number", a.serial_number, b.serial_number),
        ):
            if one and two and one != two:
                raise InputError(
                    f"{where} are of different units ({what} {one} and {two}). A trace is of one unit: trace each"
                    " unit's logs by themselves."
                )
        if {a.kind, b.kind} == {"measured", "simulated"}:
            raise InputError(
                f"{where} are measured and simulated: what is found on one says nothing of the other. Trace them apart."
            )
        if a.accel_sign != b.accel_sign or a.gyro_sign != b.gyro_sign:
            raise InputError(
                f"{where} have different signs (--accel-sign {a.accel_sign:+d} and {b.accel_sign:+d}, --gyro-sign"
                f" {a.gyro_sign} and {b.gyro_sign}): that is a property of the unit. Import again the one whose sign is"
                " wrong."
            )
        if not np.array_equal(a.axes().mount, b.axes().mount):
            one, two = (format_mount(x.axes().mount) for x in (a, b))
            raise InputError(
                f"{where} have different mountings ({one} and {two}): effects are told by how the unit sits on the"
                " table. Trace the logs of one mounting at a time, or import again the one whose --mount is wrong."
            )
        if abs(a.gravity_mps2 - b.gravity_mps2) > 1e-5 or abs(a.latitude_deg - b.latitude_deg) > 0.01:
            raise InputError(
                f"{where} are from different sites (gravity {a.gravity_mps2:.5f} and {b.gravity_mps2:.5f} m/s²,"
                f" latitude {a.latitude_deg:.3f}° and {b.latitude_deg:.3f}°). If it was one place, import again with"
                " the same --site and --gravity; else trace each site by itself."
            )


def digest(read: LoggedRun) -> str:
    """Of the samples, whatever the file is called."""
    content = hashlib.sha256(read.run.t.tobytes())
    content.update(np.ascontiguousarray(read.run.reading).tobytes())
    return content.hexdigest()


def _check_copies(reads: Sequence[LoggedRun]) -> None:
    seen: dict[str, LoggedRun] = {}
    for read in reads:
        samples = digest(read)
        before = seen.get(samples)
        if before is not None:
            same = (
                f"{read.path} is given twice"
                if before.path == read.path
                else f"{before.path} and {read.path} hold the same samples"
            )
            raise InputError(f"{same}: a run counts once. Leave one out.")
        seen[samples] = read


# ---------------------------------------------------------------------------------------------- a run and its reference


@dataclass(frozen=True, slots=True)
class _GriddedRun:
    """A run on an even grid: what was read, what a perfect unit reads (instrument axes, (n, 6)), which blocks count."""

    read: LoggedRun
    period: float
    readings: Array
    expected: Array
    good: NDArray[np.bool_]
    alive: NDArray[np.bool_]

    def moving(self) -> NDArray[np.bool_]:
        """Blocks in which the table turns."""
        return np.asarray(np.linalg.norm(self.expected[:, :3], axis=1) > _MOVING)


def check_reference(read: LoggedRun) -> None:
    """Refuse a reference that contradicts the readings: a wrong sign, wrong angles, wrong rates, a wrong time.

    Raises InputError: the message says which, how much, and what mends it.
    """
    seen = _seen(read)
    if not seen.good.any():
        raise InputError(
            f"{read.path}: no reading can be used: all are flagged, or the reference is known nowhere. Name another"
            " reference: --reference level|gravity|FILE."
        )
    _check_rest(seen)
    _check_sign(seen)
    _check_rates(seen)
    _check_angles(seen)


def _seen(read: LoggedRun) -> _GriddedRun:
    run = read.run
    # at rest nothing is faster than a block, and a day of samples is large
    length = BLOCK_S if run.still else _STEP
    made = average(run, length if run.full_rate is None else max(length, ROWS_A_BLOCK / run.rate_hz))
    # where only the attitude is known the accelerometers are used at rest, and the gyros say whether it fits
    used = made.weight > 0.0
    lost = ~used.any(axis=0)  # a channel that is not there, or is dead, takes nothing from the others
    used[:, lost] = not lost.all()
    good: NDArray[np.bool_] = np.asarray(used.all(axis=1) if run.attitude is None else used[:, :3].all(axis=1))
    expected = np.empty_like(made.y)
    made.mean([(lambda inputs: inputs.x, slice(0, 6))], expected)
    readings = made.y + expected
    # a channel that never changes, or is not there, says nothing about the reference
    there = good[:, None] & (made.weight > 0.0)
    first = readings[np.argmax(there, axis=0), np.arange(6)]
    alive: NDArray[np.bool_] = np.asarray(np.ptp(np.where(there, readings, first), axis=0) > _SAME)
    return _GriddedRun(read, made.period, readings, expected, good, alive)


def _check_rest(seen: _GriddedRun) -> None:
    """A unit that is said to be at rest must not turn."""
    if not seen.read.run.still:
        return
    # by quantiles, which a few wild samples do not move; of accelerometers two, since one may be faulty
    low, high = np.quantile(seen.readings[seen.good], (0.1, 0.9), axis=0)
    spread = np.rad2deg(high - low)[:3] / _QUANTILES
    sway = float(np.sort((high - low)[3:])[1]) / _QUANTILES
    if spread.max() > _TURNS_DPS or sway > _SWAYS:
        raise InputError(
            f"{seen.read.path}: the unit moves in this log (rates vary by {spread.max():.1f} deg/s, specific force by"
            f" {sway / STANDARD_GRAVITY:.2f} g), and the reference ({seen.read.info.reference}) says that it is at"
            " rest. Name how the table moves: --reference FILE, a table profile or a trajectory with attitude."
        )


def _check_sign(seen: _GriddedRun) -> None:
    """The readings of gravity must not be its opposite."""
    use = seen.alive[3:] if seen.alive[3:].any() else np.ones(3, bool)
    read, expected = seen.readings[seen.good, 3:][:, use], seen.expected[seen.good, 3:][:, use]
    energy = float(np.sum(expected**2))
    info, gamma = seen.read.info, seen.read.info.gravity_mps2
    if energy < 0.1 * gamma**2 * len(expected):
        return
    share = float(np.sum(read * expected)) / energy
    if share > -0.5:
        return
    off = (1.0 - share) * gamma / info.g_unit
    raise InputError(
        f"{seen.read.path}: the accelerometers read the opposite of what the reference ({info.reference}) says,"
        f" {off:.2f} g off along gravity, with --accel-sign {info.accel_sign:+d}. Either the sign is the other one:"
        f" import again with --accel-sign {-info.accel_sign:+d}; or the unit is mounted the other way up (now --mount"
        f" {info.mount}), or the angles of the reference count the other way (`sign` in its profile)."
    )


def _check_rates(seen: _GriddedRun) -> None:
    """While the table turns, the gyros must follow it, and at its time."""
    moving = seen.moving() & seen.good
    axes = [k for k in range(3) if seen.alive[k] and np.std(seen.expected[seen.good, k]) > _MOVING]
    if moving.sum() < 20 or not axes:
        return
    wanted, read = seen.expected[:, axes], seen.readings[:, axes]
    r, x = read[seen.good], wanted[seen.good]
    r, x = r - r.mean(axis=0), x - x.mean(axis=0)
    shares = np.sum(r * x, axis=0) / np.sum(x * x, axis=0)
    unlike = np.sum((r - x) ** 2, axis=0) / np.sum(x * x, axis=0)
    signs = np.where(shares < -0.5, -1.0, 1.0)
    names = [("x", "y", "z")[k] for k in axes]
    late, left = _shift(seen, read, wanted)
    much = min(0.5 * float(np.mean((r - x) ** 2)), 0.1 * float(np.mean(r**2)), float(np.mean((r - signs * x) ** 2)))
    if abs(late) > _SHIFT and left < much:
        word = "late" if late > 0.0 else "early"
        raise InputError(
            f"{seen.read.path}: the gyros follow the reference {abs(late):.2f} s {word}: its time is not the log's."
            f" Shift the reference by {late:+.2f} s, or let it be found from the gyros: a table profile with"
            ' align = "gyro".'
        )
    if (signs < 0.0).any():
        turned = ", ".join(name for name, sign in zip(names, signs, strict=True) if sign < 0.0)
        raise InputError(
            f"{seen.read.path}: gyro {turned} reads the opposite of the table's rate. Turn the table's axis round"
            " (`sign` in the profile), or import again with --gyro-sign or another --mount."
        )
    # one axis may be faulty; most of them are not
    if np.mean(unlike > 0.5) <= 0.5:
        return
    worst = int(np.argmax(unlike))
    rms = float(np.rad2deg(np.sqrt(np.mean((r - x)[:, worst] ** 2))))
    raise InputError(
        f"{seen.read.path}: the gyros do not follow the reference while it turns: gyro {names[worst]} is off by"
        f" {rms:.2f} deg/s (rms) and sees {100.0 * shares[worst]:.0f} % of its rate. It is another log's profile, or"
        " the mounting is another one: name the right --reference, or import again with the right --mount"
        " and rates in deg/s."
    )


def _shift(seen: _GriddedRun, read: Array, wanted: Array) -> tuple[float, float]:
    """Shift at which the readings follow best, s, and the mean square of what it leaves."""
    n = len(read)
    weight = seen.good[:, None]
    r = np.where(weight, read - read[seen.good].mean(axis=0), 0.0)
    x = np.where(weight, wanted - wanted[seen.good].mean(axis=0), 0.0)
    size = 1 << (2 * n - 1).bit_length()
    cross = np.fft.irfft(np.fft.rfft(r, size, axis=0) * np.conj(np.fft.rfft(x, size, axis=0)), size, axis=0).sum(axis=1)
    most = min(int(_LONGEST_SHIFT / seen.period), n // 2)
    lags = np.arange(-most, most + 1)
    # r(k + lag) beside x(k), over the part that both have
    of_r, of_x = (np.append(0.0, np.cumsum(np.sum(v * v, axis=1))) for v in (r, x))
    r_part = of_r[np.minimum(n, n + lags)] - of_r[np.maximum(0, lags)]
    x_part = of_x[np.minimum(n, n - lags)] - of_x[np.maximum(0, -lags)]
    misfit = (r_part + x_part - 2.0 * cross[lags]) / (n - np.abs(lags)) / r.shape[1]
    best = int(np.argmin(misfit))
    fine = 0.0
    if 0 < best < misfit.size - 1:
        below, least, above = misfit[best - 1 : best + 2]
        fine = 0.5 * (below - above) / (below - 2.0 * least + above)
    return (float(lags[best]) + fine) * seen.period, float(misfit[best])


def _check_angles(seen: _GriddedRun) -> None:
    """At rest, gravity must be felt in the direction that the angles say."""
    still = seen.good & (np.linalg.norm(seen.expected[:, :3], axis=1) < _AT_REST)
    if still.sum() < 20 or not seen.alive[3:].sum() >= 2:
        return
    expected = seen.expected[still, 3:]
    # a channel that never changes is the tracer's matter, as one that is not there
    read = np.where(seen.alive[3:], seen.readings[still, 3:], expected)
    gamma = seen.read.info.gravity_mps2
    norm = np.linalg.norm(read, axis=1)
    ratio = float(np.median(norm)) / gamma
    if seen.alive[3:].all() and not _LEAST < ratio < 1.0 / _LEAST:
        raise InputError(
            f"{seen.read.path}: at rest, the specific force has magnitude {ratio * gamma:.3g} m/s², and gravity is"
            f" {gamma:.3f}: readings are in other units. Import again with accel in g and gyro in deg/s."
        )
    # where the magnitude is wrong, a channel is; where it is right, the direction says what the angles are worth
    whole = np.abs(norm - gamma) < _NORM * gamma
    if whole.mean() < 0.2:
        return
    cosine = np.sum(read * expected, axis=1)[whole] / norm[whole] / gamma
    off = np.arccos(np.clip(cosine, -1.0, 1.0))
    typical = float(np.quantile(off, 0.8))
    if typical < _DIRECTION:
        return
    mg = 2.0 * np.sin(0.5 * typical) * gamma / seen.read.info.g_unit * 1e3
    raise InputError(
        f"{seen.read.path}: at rest, gravity is felt {np.rad2deg(typical):.0f}° from where the reference"
        f" ({seen.read.info.reference}) says ({mg:.0f} mg of residual). Its angles are not those of this log, an axis"
        " counts the other way (`sign` in the profile), or the mounting is another one (--mount on import). A unit that"
        " is only at rest, at whatever attitude: --reference gravity."
    )


# ------------------------------------------------------------------------------------------------------- what to expect


def expectations(training: Sequence[LoggedRun], heldout: LoggedRun | None) -> list[str]:
    """Sentences on what these logs cannot give, before anything is traced."""
    said = []
    if heldout is not None and heldout.run.seconds < _JUDGED_S:
        said.append(
            f"the held-out run lasts {heldout.run.seconds:.0f} s: under {_JUDGED_S:.0f} s the error after is uncertain,"
            " and nothing is called explained by it alone"
        )
    said += [
        f"{read.run.name} lasts {read.run.seconds:.0f} s: what its motion excites can be told, nothing slow can, such"
        f" as drift and warm-up; nor the error after a bias hold of {HOLD_S:.0f} s"
        for read in training
        if read.run.seconds < HOLD_S
    ]
    spans = _temperature_spans(training)
    if not spans:
        said.append("no temperature in the logs: thermal effects cannot be found")
    elif max(spans) < _THERMAL_K:
        together = [read.run.temperature for read in training if read.run.temperature is not None]
        across = max(float(t.max()) for t in together) - min(float(t.min()) for t in together)
        said.append(
            f"temperature is constant (within {max(spans):.2f} K in a run, {across:.2f} K over all): thermal effects"
            " cannot be found; record a warm-up"
        )
    if all(read.run.still for read in training):
        said.append("the unit never moves: only time, temperature, noise and data faults can be traced")
    return said


def _temperature_spans(reads: Sequence[LoggedRun]) -> list[float]:
    """How far temperature goes within each power-on, K."""
    ends: dict[str, tuple[float, float]] = {}
    for number, read in enumerate(reads):
        T = read.run.temperature
        if T is not None:
            low, high = ends.get(read.run.power_on or str(number), (np.inf, -np.inf))
            ends[read.run.power_on or str(number)] = min(low, float(T.min())), max(high, float(T.max()))
    return [high - low for low, high in ends.values()]
