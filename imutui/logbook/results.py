"""The result document of a live run or a replay (JSON): one builder, so that the two are equal in all but timings.

Also the one place where the filter's state leaves SI and body axes for the instrument's axes, mg and deg/s.
"""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeAlias, TypedDict, final

import numpy as np

import imutui
from filters import attitude, earth, specification, state
from filters.health.finding import HealthEntry
from filters.imu import CHANNELS, AxisMap
from filters.state import NavState
from filters.tracing.trace_document import IdentityEntry
from imutui.document_shape import VERSION
from imutui.estimate_history import HistoryRows
from imutui.filter_snapshot import CauseSnapshot
from imutui.logbook import departures
from imutui.logbook.health import has_readings
from imutui.logbook.reading import AS_STATED, ReadingFields
from imutui.logbook.session_info import SessionInfo

if TYPE_CHECKING:
    from filters.kalman.runner import Estimator

_BIASES = ("accel_bias", "gyro_bias")
PLACE = ("position", "velocity")  # what is not observable where only the attitude is known, beside biases
_NAMES = tuple(f"{bias}_{axis}" for bias in _BIASES for axis in "xyz")

EXACT = "the reference is fed exact, not drawn from R: NIS is far below its degrees of freedom by construction"
EXACT_BUT_LARGE = (
    "the reference is fed exact, not drawn from R, which makes NIS small by construction: above its degrees of freedom,"
    " as here, the readings do more than the filter's noise and drift allow for"
)
DRAWN = "measurements are drawn with covariance R"
MOVING = "the trajectory is fed as it is: NIS compares its own errors with R, which was not made for it"


Three: TypeAlias = Annotated[list[float | None], 3]


class BiasFields(TypedDict):
    """Biases, in the units of their names; None where they cannot be seen."""

    accel_bias_mg: Three
    gyro_bias_dps: Three


class StateFields(TypedDict):
    """Navigation state and biases, in the units of their names; None where it cannot be seen."""

    position_deg_m: Three
    velocity_mps: Three
    rpy_deg: Annotated[list[float], 3]
    accel_bias_mg: Three
    gyro_bias_dps: Three


class SdFields(TypedDict):
    """Standard deviations that go with `StateFields`; of the position in metres north, east, down."""

    position_m: Three
    velocity_mps: Three
    rpy_deg: Three
    accel_bias_mg: Three
    gyro_bias_dps: Three


class NisFields(TypedDict):
    """Mean normalised innovation squared with its 95 % band, whether it is a test, and why (not)."""

    mean: float | None
    first: float | None
    dof: float
    band95: Annotated[list[float | None], 2]
    is_test: bool
    why: str


class SpreadFields(TypedDict):
    """Mean and standard deviation of the estimates after convergence."""

    mean: StateFields
    sd: SdFields


class WhiteNoise(TypedDict):
    """Angle and velocity random walk, instrument axes; None where nothing is known yet."""

    gyro_arw_deg_sqrt_h: Three
    accel_vrw_mps_sqrt_h: Three


class ProcessNoise(WhiteNoise):
    """What the filter takes for noise: white, and walks of the biases; `source` is where it comes from."""

    source: str
    gyro_walk_dps_sqrt_h: Three
    accel_walk_mps2_sqrt_h: Three


class NoiseFields(WhiteNoise):
    """White noise measured on the log, beside the specification's and the filter's own."""

    specification: WhiteNoise
    used: ProcessNoise
    relative_sd: float | None
    """Standard deviation of the measured ones, as a share of them; None where nothing was measured."""


class EffectField(TypedDict):
    """State of an effect that joined the filter, SI."""

    name: str
    value: float
    sd: float


class GapField(TypedDict):
    """A gap in the samples: `t` of the last one before it, s since the first, and how long it lasts."""

    t: float
    seconds: float


class RemainderField(TypedDict):
    """What the model leaves unexplained on a channel: means of 10 s over what noise allows, of so many windows."""

    channel: str
    ratio: float | None
    windows: int


class EstimatePoints(TypedDict):
    """Estimates at instants, s since the first sample; closer together at the beginning, while they converge.

    Biases and their standard deviations are of the gyros in deg/s, then of the accelerometers in mg, None where they
    cannot be seen; NIS is that of the update at the instant (None without one), with its degrees of freedom.
    """

    t: list[float]
    bias: list[list[float | None]]
    sd: list[list[float | None]]
    nis: list[float | None]
    dof: list[float]


class PartResult(TypedDict):
    """A finished file of a recording in several; both are true where no filter ran, `passes` is a verdict's."""

    log: str
    converged: bool
    passes: bool


class ConvergedFields(TypedDict):
    """When each bias had converged, s since the first sample, instrument axes; None where it has not."""

    accel_bias: Three
    gyro_bias: Three


class _RunFields(TypedDict):
    """What is known of every run of samples, whether a filter ran or not."""

    version: int
    log: str
    kind: str
    filter: str
    samples: int
    finished: bool
    lost_packets: int
    bad_checksums: int
    alarms: list[str]
    assumed: list[str]  # of another program's log, in words; empty for a log of imutui
    health: list[HealthEntry]
    """Faults of the channels, the worst first."""
    log_sha256: str | None
    identity: IdentityEntry
    library: str
    # start_utc, temperature_degc: of the log, what `imutui report` fills in where the log is at hand; else None
    start_utc: str | None
    temperature_degc: list[float] | None
    damage: str | None  # what is wrong with the file that was replayed, if anything
    parts: list[PartResult]
    """Of a live recording in several files: all of them, the last one's result being this. Else empty."""


@final
class ReadingsDocument(_RunFields):
    """Result of a live run without a filter, as `--json` prints it."""


@final
class ResultDocument(_RunFields):
    """Result of a live run or a replay in which a filter ran, as `--json` prints it."""

    duration_s: float
    rate_hz: float | None
    reference: str
    accel_sign: int
    mount: str
    measurements: str
    seed: int | None
    unobservable: list[str]
    final: StateFields
    sd: SdFields
    site_stated: bool
    site_sd_mg: Annotated[list[float], 3]
    """What an unstated site adds, in quadrature, to `sd` of the accelerometer biases, instrument axes."""
    spread: SpreadFields | None
    converged: bool
    converged_s: ConvergedFields
    nis: NisFields
    noise: NoiseFields
    effects: list[EffectField]
    history_known: bool
    """Whether the effects go on from what those of the file before remembered of temperature."""
    gaps: list[GapField]
    rejected: int
    confounded: list[str]
    remainder: list[RemainderField]
    temperature_k_per_min: float | None
    held_since_s: float | None
    """When the reference ended: from then on biases are held, and navigation states are those of then."""
    causes: list[CauseSnapshot]
    causes_gone: list[CauseSnapshot]
    """Of a unit at rest: effects that its residual showed while it was filtered."""
    departure: str | None
    """With a table profile: where the readings depart from the model most certainly, in a sentence."""
    filter_s: float
    read_s: float
    steps_per_s: float | None
    times_real_time: float | None
    config_sha256: str
    effects_of_other_unit: str | None  # whose effects a replay took, if not this unit's
    course: HistoryRows | None
    """Of a replay on the screen: gyro biases in deg/s, then accelerometer biases in mg, over time."""
    asked: ReadingFields  # how a replay read the log other than it states
    truth: StateFields | None  # of the demo: what the virtual instrument really has


RunDocument: TypeAlias = ResultDocument | ReadingsDocument
"""Result of a run; a filter ran if it has `final`."""


def state_fields(nav: NavState, axes: AxisMap, g_unit: float, seen: np.ndarray, *, placed: bool = True) -> StateFields:
    """Navigation state and biases at the edge: degrees, mg, deg/s, instrument axes; `None` for a bias not seen.

    `seen`: whether each bias is observable, accelerometer then gyro, instrument axes, bool, shape (6,).
    `placed`: whether position and velocity are.
    """
    accel = axes.accel_to_instrument(nav.accel_bias) / g_unit * 1e3
    longitude = np.remainder(np.rad2deg(nav.longitude) + 180.0, 360.0) - 180.0
    return {
        "position_deg_m": _where(np.array([np.rad2deg(nav.latitude), longitude, nav.height]), np.full(3, placed)),
        "velocity_mps": _where(nav.velocity_n, np.full(3, placed)),
        "rpy_deg": np.rad2deg(attitude.to_rpy(nav.C_nb)).tolist(),
        "accel_bias_mg": _where(accel, seen[:3]),
        "gyro_bias_dps": _where(np.rad2deg(axes.gyro_to_instrument(nav.gyro_bias)), seen[3:]),
    }


def site_sd_mg(estimator: "Estimator", info: SessionInfo) -> np.ndarray:
    """Return what an unstated site adds to the uncertainty of the accelerometer biases.

    A filter that assumes another gravity than the true one takes the difference for a bias of the accelerometers along
    the vertical. Standard deviation σ_γ |v_i|, with the mean vertical v over the run. The filter does not know of it,
    so it is added, in quadrature, wherever its standard deviations leave it.

    Returns mg, instrument axes, shape (3,); zero where the site is stated.
    """
    if info.site_stated:
        return np.zeros(3)
    return info.axes().sd_to_instrument(np.abs(estimator.vertical)) * earth.GRAVITY_SPREAD / info.g_unit * 1e3


def sd_fields(
    P: np.ndarray,
    nav: NavState,
    axes: AxisMap,
    g_unit: float,
    seen: np.ndarray,
    *,
    site_mg: np.ndarray | float = 0.0,
    placed: bool = True,
) -> SdFields:
    """Return the standard deviations that go with `state_fields`, from a covariance (15, 15).

    `site_mg`: `site_sd_mg` of the run, added to the accelerometers' in quadrature.
    """
    sd = np.sqrt(np.diag(P))
    J = attitude.rpy_jacobian(nav.C_nb)
    rpy = np.sqrt(np.diag(J @ P[state.ATTITUDE, state.ATTITUDE] @ J.T))
    accel = np.hypot(axes.sd_to_instrument(sd[state.ACCEL_BIAS]) / g_unit * 1e3, site_mg)
    return {
        "position_m": _where(sd[state.POSITION], np.full(3, placed)),
        "velocity_mps": _where(sd[state.VELOCITY], np.full(3, placed)),
        "rpy_deg": _where(np.rad2deg(rpy), np.isfinite(rpy)),
        "accel_bias_mg": _where(accel, seen[:3]),
        "gyro_bias_dps": _where(np.rad2deg(axes.sd_to_instrument(sd[state.GYRO_BIAS])), seen[3:]),
    }


def seen_axes(estimator: "Estimator", axes: AxisMap) -> np.ndarray:
    """Whether each bias is observable, accelerometer then gyro, instrument axes, bool, shape (6,)."""
    seen = np.array(estimator.observable, float).reshape(2, 3)
    return np.concatenate([axes.sd_to_instrument(part) for part in seen]) > 0.5


def converged_since(estimator: "Estimator", axes: AxisMap, reads: np.ndarray) -> ConvergedFields:
    """Return when each bias was declared converged, s, instrument axes; None where it is not.

    `reads`: whether each channel measures anything, accelerometers then gyros, shape (6,).
    """
    since = estimator.monitor.convergence().since
    as_numbers = np.array(
        [-1.0 if s is None or not seen else s for s, seen in zip(since, estimator.observable, strict=True)]
    )
    accel, gyro = (
        [
            float(s) if s >= 0.0 and ok else None
            for s, ok in zip(axes.sd_to_instrument(as_numbers[part]), reads[part], strict=True)
        ]
        for part in (slice(0, 3), slice(3, 6))
    )
    return {"accel_bias": accel, "gyro_bias": gyro}


def of_readings(
    info: SessionInfo,
    log: Path,
    samples: int,
    lost: tuple[int, int],
    health: list[HealthEntry],
    log_sha256: str | None,
    *,
    finished: bool = True,
) -> ReadingsDocument:
    """Result of a run without a filter, ready for JSON.

    `lost`: lost packets and bad checksums, as the acquisition counted.
    `health`: faults of the channels.
    `finished`: whether the file has its footer.
    """
    return {
        "version": VERSION,
        "log": str(log.resolve()),
        "kind": info.kind,
        "filter": info.filter,
        "samples": samples,
        "finished": finished,
        "lost_packets": lost[0],
        "bad_checksums": lost[1],
        "alarms": [],
        "assumed": [],
        "health": health,
        "log_sha256": log_sha256,
        "identity": info.identity(),
        "library": f"imutui {imutui.__version__}",
        "start_utc": None,
        "temperature_degc": None,
        "damage": None,
        "parts": [],
    }


def document(
    readings: ReadingsDocument, estimator: "Estimator", info: SessionInfo, filter_s: float, read_s: float
) -> ResultDocument:
    """Result of a run with a filter, ready for JSON.

    `readings`: its result without a filter; a channel that measures nothing by its `health` has no bias.
    `estimator`: after its last sample; it must have had one.
    `filter_s`, `read_s`: how long it took; only in these do live and replay differ.
    Raises ValueError if there was no sample.
    """
    from filters.motion.alignment import Turning

    latest = estimator.latest
    if latest is None or estimator.reference is None:
        raise ValueError("`estimator` has had no sample")
    axes, g_unit = info.axes(), info.g_unit
    reads, observable = has_readings(readings["health"]), seen_axes(estimator, axes)
    seen = observable & reads
    nav, P = latest.belief.nav, latest.belief.P
    rest = estimator.first_rest
    begun, duration = (0.0, latest.t) if rest is None else (rest.begun or 0.0, rest.last_t or latest.t)
    used = latest.t - begun
    # such a reference does not say where the unit is
    unplaced = PLACE if isinstance(estimator.reference, Turning) else ()
    site_mg = site_sd_mg(estimator, info)
    return {
        **readings,
        "samples": estimator.taken,
        "alarms": estimator.alarms(),
        "duration_s": duration,
        "rate_hz": (estimator.taken - 1) / used if used > 0.0 else None,
        "reference": info.reference,
        "accel_sign": info.accel_sign,
        "mount": info.mount,
        "measurements": info.measurements,
        "seed": info.seed if info.measurements == "drawn" else None,
        "unobservable": [*unplaced, *(name for name, s in zip(_NAMES, seen, strict=True) if not s)],
        "final": state_fields(nav, axes, g_unit, seen, placed=not unplaced),
        "sd": sd_fields(P, nav, axes, g_unit, seen, site_mg=site_mg, placed=not unplaced),
        "site_stated": info.site_stated,
        "site_sd_mg": site_mg.tolist(),
        "spread": _spread(estimator, axes, g_unit, seen),
        "converged": estimator.converged and bool(reads[observable].all()),
        "converged_s": converged_since(estimator, axes, reads),
        "nis": nis_fields(estimator),
        "noise": noise_fields(estimator, axes, info.noise),
        "effects": effect_fields(estimator),
        "history_known": bool(info.memory),
        "gaps": [{"t": t, "seconds": seconds} for t, seconds in estimator.gaps],
        "rejected": estimator.rejected,
        "confounded": estimator.confounded(),
        "remainder": remainder_fields(estimator, axes),
        "temperature_k_per_min": estimator.temperature.k_per_min(),
        "held_since_s": estimator.held_since,
        "departure": departures.sentence(estimator, axes, g_unit),
        "causes": departures.causes(estimator, axes, g_unit),
        "causes_gone": departures.withdrawn(estimator, axes, g_unit),
        "filter_s": filter_s,
        "read_s": read_s,
        "steps_per_s": estimator.nis_count / filter_s if filter_s > 0.0 else None,
        "times_real_time": duration / filter_s if filter_s > 0.0 else None,
        "config_sha256": info.config_sha256(),
        "effects_of_other_unit": None,
        "course": None,
        "asked": AS_STATED.document(),
        "truth": None,
    }


TIMINGS = ("filter_s", "read_s", "steps_per_s", "times_real_time")
"""Fields in which two runs over equal samples may differ."""


def nis_fields(estimator: "Estimator") -> NisFields:
    """Mean NIS with its band, and whether it is a test."""
    from filters.kalman import consistency

    # noise drawn on top of a trajectory's own errors makes no test of it
    followed = estimator.settings.reference == "trajectory"
    is_test = estimator.settings.measurements == "drawn" and not followed
    dof = estimator.dof
    band = consistency.nis_band(dof, estimator.nis_count) if dof else (None, None)
    mean = estimator.nis_sum / estimator.nis_count if estimator.nis_count else None
    return {
        "mean": mean,
        "first": estimator.first_nis,
        "dof": int(dof) if dof == int(dof) else dof,
        "band95": list(band),
        "is_test": is_test,
        "why": _why(mean, dof, is_test=is_test, followed=followed),
    }


def _why(mean: float | None, dof: float, *, is_test: bool, followed: bool) -> str:
    """Why NIS is a test or none."""
    if is_test:
        return DRAWN
    if followed:
        return MOVING
    return EXACT if mean is None or mean <= dof else EXACT_BUT_LARGE


def noise_fields(estimator: "Estimator", axes: AxisMap, source: str) -> NoiseFields:
    """White noise measured on the log beside the specification's and the filter's own, instrument axes."""
    found = estimator.monitor.noise()
    measured = np.full(6, np.nan) if found is None else found
    if estimator.settings.unread:
        measured = np.where(estimator.settings.unread, np.nan, measured)
    spec, used = estimator.settings.spec, estimator.settings.process_noise()
    stated = np.full(3, 1.0 if spec != specification.NOT_KNOWN else np.nan)
    return {
        **_white(measured[3:], measured[:3], axes),
        "relative_sd": estimator.monitor.noise_relative_sd(),
        "specification": _white(stated * spec.gyro_arw, stated * spec.accel_vrw, axes),
        "used": {
            "source": source,
            **_white(np.array(used.gyro_arw), np.array(used.accel_vrw), axes),
            "gyro_walk_dps_sqrt_h": _per_hour(np.rad2deg(axes.sd_to_instrument(np.array(used.gyro_walk)))),
            "accel_walk_mps2_sqrt_h": _per_hour(axes.sd_to_instrument(np.array(used.accel_walk))),
        },
    }


def _white(gyro: np.ndarray, accel: np.ndarray, axes: AxisMap) -> WhiteNoise:
    """White noise per √s, SI and body axes, per √h and in instrument axes."""
    return {
        "gyro_arw_deg_sqrt_h": _per_hour(np.rad2deg(axes.sd_to_instrument(gyro))),
        "accel_vrw_mps_sqrt_h": _per_hour(axes.sd_to_instrument(accel)),
    }


def _per_hour(density: np.ndarray) -> list[float | None]:
    """Per √h of what is per √s (of a rate or an acceleration too)."""
    return _where(density * 60.0, np.isfinite(density))


def remainder_fields(estimator: "Estimator", axes: AxisMap) -> list[RemainderField]:
    """What the model does not explain, by channel; None where a bias cannot be seen, or nothing is known yet."""
    found = estimator.monitor.remainder()
    ratio = np.full(6, np.nan)
    if found.ratio is not None:
        parts = found.ratio[3:], found.ratio[:3]
        ratio = np.concatenate([axes.sd_to_instrument(part) for part in parts])
        accel, gyro = np.split(seen_axes(estimator, axes), 2)
        ratio[~np.concatenate([gyro, accel])] = np.nan
    return [
        {"channel": channel, "ratio": float(r) if np.isfinite(r) else None, "windows": found.windows}
        for channel, r in zip(CHANNELS, ratio, strict=True)
    ]


def effect_fields(estimator: "Estimator") -> list[EffectField]:
    """States of the effects that joined the filter, SI; an empty list without effects."""
    if estimator.effects is None:
        return []
    values, P = estimator.extra()
    sd = np.sqrt(np.maximum(np.diag(P)[state.SIZE :], 0.0))
    return [
        {"name": name, "value": float(value), "sd": float(s)}
        for name, value, s in zip(estimator.effects.names, values, sd, strict=True)
    ]


def _spread(estimator: "Estimator", axes: AxisMap, g_unit: float, seen: np.ndarray) -> SpreadFields | None:
    moments = estimator.after_convergence
    if moments is None or estimator.reference is None:
        return None
    mean = estimator.reference.start()[0].plus(moments.mean)
    return {
        "mean": state_fields(mean, axes, g_unit, seen),
        "sd": sd_fields(moments.covariance, mean, axes, g_unit, seen),
    }


def _where(values: np.ndarray, seen: np.ndarray) -> list[float | None]:
    return [float(value) if s else None for value, s in zip(values, seen, strict=True)]
