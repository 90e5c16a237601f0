"""What an estimator has come to, as `imutui.estimates` has it, and the result document of a run (JSON).

One builder, so that a running filter, a live run's result and a replay's are equal in all but timings. Also the one
place where the filter's numbers leave SI and body axes for the instrument's axes, mg and deg/s.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, TypedDict, cast, final

import numpy as np

import imutui
from filters import attitude, earth, specification, state
from filters.health.finding import HealthEntry
from filters.imu import CHANNELS, AxisMap
from filters.kalman.settings import Settings
from filters.state import NavState
from imutui.document_shape import VERSION, empty
from imutui.estimate_history import HistoryRows
from imutui.estimates import (
    BiasFields,
    ConvergedFields,
    EffectField,
    Estimates,
    NisFields,
    NoiseFields,
    RemainderField,
    RunFields,
    SdFields,
    StateFields,
    WhiteNoise,
)
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


class SpreadFields(TypedDict):
    """Mean and standard deviation of the estimates after convergence."""

    mean: StateFields
    sd: SdFields


class GapField(TypedDict):
    """A gap in the samples: `t` of the last one before it, s since the first, and how long it lasts."""

    t: float
    seconds: float


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


class _FileFields(TypedDict):
    """What is known of the samples of every run, and of their file."""

    version: int
    log: str
    kind: str
    finished: bool
    lost_packets: int
    bad_checksums: int
    assumed: list[str]  # of another program's log, in words; empty for a log of imutui
    health: list[HealthEntry]
    """Faults of the channels, the worst first."""
    log_sha256: str | None
    library: str
    # start_utc, temperature_degc: of the log, what `imutui report` fills in where the log is at hand; else None
    start_utc: str | None
    temperature_degc: list[float] | None
    damage: str | None  # what is wrong with the file that was replayed, if anything
    parts: list[PartResult]
    """Of a live recording in several files: all of them, the last one's result being this. Else empty."""


@final
class ReadingsDocument(_FileFields, RunFields):
    """Result of a live run without a filter, as `--json` prints it."""


@final
class ResultDocument(_FileFields, Estimates):
    """Result of a live run or a replay in which a filter ran, as `--json` prints it."""

    rate_hz: float | None
    accel_sign: int
    mount: str
    measurements: str
    seed: int | None
    spread: SpreadFields | None
    history_known: bool
    """Whether the effects go on from what those of the file before remembered of temperature."""
    gaps: list[GapField]
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

TIMINGS = ("filter_s", "read_s", "steps_per_s", "times_real_time")
"""Fields in which two runs over equal samples may differ."""


# ---------------------------------------------------------------------------------------------------------- out of SI


def state_columns(nav: NavState, info: SessionInfo, seen: np.ndarray) -> dict[str, np.ndarray]:
    """Return navigation states and biases by the names of `StateFields`, each (..., 3), as many as `nav` has.

    `seen`: whether each bias is observable, as of `seen_axes`; NaN stands for one that is not.
    """
    longitude = np.remainder(np.rad2deg(nav.longitude) + 180.0, 360.0) - 180.0
    return {
        "position_deg_m": np.stack([np.rad2deg(nav.latitude), longitude, nav.height], axis=-1),
        "velocity_mps": nav.velocity_n,
        "rpy_deg": np.rad2deg(attitude.to_rpy(nav.C_nb)),
        **_biases(*info.outward(nav.accel_bias, nav.gyro_bias), seen),
    }


def sd_columns(
    P: np.ndarray, C_nb: np.ndarray, info: SessionInfo, seen: np.ndarray, site_mg: np.ndarray | float = 0.0
) -> dict[str, np.ndarray]:
    """Return the standard deviations that go with `state_columns`, by the names of `SdFields`, each (..., 3).

    `P`: covariances, shape (..., 15, 15), at attitudes `C_nb`, shape (..., 3, 3).
    `site_mg`: `site_sd_mg` of the run, added to the accelerometers' in quadrature.
    """
    sd = np.sqrt(np.diagonal(P, axis1=-2, axis2=-1))
    with np.errstate(divide="ignore", invalid="ignore"):  # at a pitch of 90° roll and yaw have none
        J = attitude.rpy_jacobian(C_nb)
        of_rpy = J @ P[..., state.ATTITUDE, state.ATTITUDE] @ np.swapaxes(J, -1, -2)
        rpy = np.sqrt(np.diagonal(of_rpy, axis1=-2, axis2=-1))
    accel, gyro = info.outward(sd[..., state.ACCEL_BIAS], sd[..., state.GYRO_BIAS], sd=True)
    return {
        "position_m": sd[..., state.POSITION],
        "velocity_mps": sd[..., state.VELOCITY],
        "rpy_deg": np.rad2deg(rpy),
        **_biases(np.hypot(accel, site_mg), gyro, seen),
    }


def _biases(accel: np.ndarray, gyro: np.ndarray, seen: np.ndarray) -> dict[str, np.ndarray]:
    """Return something of the biases by the names of `BiasFields`; NaN for those that are not `seen`."""
    return {"accel_bias_mg": np.where(seen[:3], accel, np.nan), "gyro_bias_dps": np.where(seen[3:], gyro, np.nan)}


def listed(values: np.ndarray) -> list[Any]:
    """Return numbers as JSON has them: None for what is not finite."""
    made = values.astype(object)
    made[~np.isfinite(values)] = None
    return cast("list[Any]", made.tolist())


def fields(columns: dict[str, np.ndarray], unplaced: Sequence[str] = ()) -> Any:
    """Return columns of one instant as lists; None for the biases not seen, and for a place that is not known.

    `unplaced`: `PLACE` if position and velocity are not known.
    """
    hidden = [name for name in columns if name.startswith(tuple(unplaced))] if unplaced else []
    return {name: listed(values) for name, values in columns.items()} | {name: [None] * 3 for name in hidden}


def site_sd_mg(estimator: "Estimator", info: SessionInfo) -> np.ndarray:
    """Return what an unstated site adds to the uncertainty of the accelerometer biases, mg, instrument axes, (3,).

    A filter that assumes another gravity than the true one takes the difference for a bias of the accelerometers along
    the vertical. Its standard deviation is σ_γ |v_i|, with the mean vertical v over the run. The filter does not know
    of it, so it is added, in quadrature, wherever its standard deviations leave it; zero where the site is stated.
    """
    if info.site_stated:
        return np.zeros(3)
    return info.outward(np.abs(estimator.vertical) * earth.GRAVITY_SPREAD, np.zeros(3), sd=True)[0]


def seen_axes(estimator: "Estimator", axes: AxisMap) -> np.ndarray:
    """Return whether each bias is observable, accelerometer then gyro, instrument axes, bool, shape (6,)."""
    seen = np.array(estimator.observable, float).reshape(2, 3)
    return axes.sd_to_instrument(seen).ravel() > 0.5


def converged_since(estimator: "Estimator", axes: AxisMap, reads: np.ndarray) -> ConvergedFields:
    """Return when each bias was declared converged, s, instrument axes; None where it is not.

    `reads`: whether each channel measures anything, accelerometers then gyros, shape (6,).
    """
    since = np.array(estimator.monitor.convergence().since, float)  # None is NaN
    known = np.where(estimator.observable, since, np.nan).reshape(2, 3)
    accel, gyro = np.where(reads.reshape(2, 3), axes.sd_to_instrument(known), np.nan)
    return {"accel_bias": listed(accel), "gyro_bias": listed(gyro)}


def change_10s(estimator: "Estimator | None", info: SessionInfo) -> BiasFields:
    """Return the change of the biases over the last 10 s; None while it is not known."""
    change = None if estimator is None else estimator.monitor.convergence().change
    if change is None:
        return cast("BiasFields", empty(BiasFields))
    return cast("BiasFields", fields(_biases(*info.outward(change[:3], change[3:]), ALL_SEEN)))


ALL_SEEN = np.ones(6, bool)


# ------------------------------------------------------------------------------------------------------- the builder


def estimates(estimator: "Estimator | None", info: SessionInfo, health: Sequence[HealthEntry]) -> Estimates:
    """Return what a filter has come to, between two samples.

    `estimator`: None before its code is loaded.
    `health`: faults of the channels; one that measures nothing has no bias.
    """
    if estimator is None:
        known = {"filter": info.filter, "identity": info.identity(), "reference": info.reference}
        nothing: Estimates = empty(Estimates) | known | {"site_stated": info.site_stated}
        nothing["nis"]["why"] = "no update yet"
        return nothing
    from filters.motion.alignment import Turning

    axes, latest = info.axes(), estimator.latest
    reads, observable = has_readings(health), seen_axes(estimator, axes)
    seen = observable & reads
    # such a reference does not say where the unit is
    unplaced = PLACE if isinstance(estimator.reference, Turning) else ()
    site_mg = site_sd_mg(estimator, info)
    if latest is None:
        final, sd = empty(StateFields), empty(SdFields)
    else:
        nav = latest.belief.nav
        final = fields(state_columns(nav, info, seen), unplaced)
        sd = fields(sd_columns(latest.belief.P, nav.C_nb, info, seen, site_mg), unplaced)
    return {
        "filter": info.filter,
        "identity": info.identity(),
        "reference": info.reference,
        "site_stated": info.site_stated,
        "samples": 0 if latest is None else estimator.taken,
        "alarms": estimator.alarms(),
        "duration_s": 0.0 if latest is None else _span(estimator, latest.t)[1],
        "unobservable": [*unplaced, *(name for name, s in zip(_NAMES, seen.tolist(), strict=True) if not s)],
        "final": final,
        "sd": sd,
        "site_sd_mg": site_mg.tolist(),
        "converged": estimator.converged and bool(reads[observable].all()),
        "converged_s": converged_since(estimator, axes, reads),
        "nis": _nis(estimator),
        "noise": _noise(estimator.settings, info, estimator.monitor.noise(), estimator.monitor.noise_relative_sd()),
        "effects": _effects(estimator),
        "rejected": estimator.rejected,
        "confounded": estimator.confounded(),
        "remainder": _remainder(estimator, axes),
        "temperature_k_per_min": estimator.temperature.k_per_min(),
        "held_since_s": estimator.held_since,
        "causes": departures.causes(estimator, info),
        "causes_gone": departures.withdrawn(estimator, info),
        "departure": departures.sentence(estimator, info),
    }


def _span(estimator: "Estimator", latest: float) -> tuple[float, float]:
    """Return where the samples that were used begin, and how long all samples are, s."""
    rest = estimator.first_rest
    return (0.0, latest) if rest is None else (rest.begun or 0.0, rest.last_t or latest)


def _nis(estimator: "Estimator") -> NisFields:
    """Return the mean NIS with its band, and whether it is a test."""
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
    """Return why NIS is a test or none."""
    if is_test:
        return DRAWN
    if followed:
        return MOVING
    return EXACT if mean is None or mean <= dof else EXACT_BUT_LARGE


def _noise(settings: Settings, info: SessionInfo, found: np.ndarray | None, relative_sd: float | None) -> NoiseFields:
    """Return the white noise that was measured beside the specification's and the filter's own, instrument axes."""
    axes, spec, used = info.axes(), settings.spec, settings.process_noise()
    measured = np.where(settings.unread, np.nan, np.full(6, np.nan) if found is None else found)
    stated = np.full(3, 1.0 if spec != specification.NOT_KNOWN else np.nan)
    return {
        **_white(measured[3:], measured[:3], axes),
        "relative_sd": relative_sd,
        "specification": _white(stated * spec.gyro_arw, stated * spec.accel_vrw, axes),
        "used": {
            "source": info.noise,
            **_white(np.array(used.gyro_arw), np.array(used.accel_vrw), axes),
            "gyro_walk_dps_sqrt_h": _per_hour(np.rad2deg(axes.sd_to_instrument(np.array(used.gyro_walk)))),
            "accel_walk_mps2_sqrt_h": _per_hour(axes.sd_to_instrument(np.array(used.accel_walk))),
        },
    }


def _white(gyro: np.ndarray, accel: np.ndarray, axes: AxisMap) -> WhiteNoise:
    """Return white noise per √s, SI and body axes, as it is per √h and in instrument axes."""
    return {
        "gyro_arw_deg_sqrt_h": _per_hour(np.rad2deg(axes.sd_to_instrument(gyro))),
        "accel_vrw_mps_sqrt_h": _per_hour(axes.sd_to_instrument(accel)),
    }


def _per_hour(density: np.ndarray) -> list[float | None]:
    """Return per √h what is per √s (of a rate or an acceleration too)."""
    return listed(density * 60.0)


def _remainder(estimator: "Estimator", axes: AxisMap) -> list[RemainderField]:
    """Return what the model does not explain, by channel; None where a bias cannot be seen, or nothing is known yet."""
    found = estimator.monitor.remainder()
    ratio = np.full(6, np.nan)
    if found.ratio is not None:
        ratio = np.where(seen_axes(estimator, axes), axes.sd_to_instrument(found.ratio.reshape(2, 3)).ravel(), np.nan)
    return [
        {"channel": channel, "ratio": one, "windows": found.windows}
        for channel, one in zip(CHANNELS, listed(np.roll(ratio, 3)), strict=True)
    ]


def _effects(estimator: "Estimator") -> list[EffectField]:
    """Return the states of the effects that joined the filter, each in the unit that its name ends with."""
    if estimator.effects is None or estimator.latest is None:
        return []
    values, P = estimator.extra()
    sd = np.sqrt(np.maximum(np.diag(P)[state.SIZE :], 0.0))
    return [
        {"name": name, "value": float(value), "sd": float(s)}
        for name, value, s in zip(estimator.effects.names, values, sd, strict=True)
    ]


# ---------------------------------------------------------------------------------------------------- a run's document


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
    """Return the result of a run without a filter, ready for JSON.

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
    """Return the result of a run with a filter, ready for JSON.

    `readings`: its result without a filter.
    `estimator`: after its last sample; it must have had one.
    `filter_s`, `read_s`: how long it took; only in these do live and replay differ.
    Raises ValueError if there was no sample.
    """
    latest = estimator.latest
    if latest is None:
        raise ValueError("`estimator` has had no sample")
    begun, duration = _span(estimator, latest.t)
    used = latest.t - begun
    return {
        **readings,
        **estimates(estimator, info, readings["health"]),
        "rate_hz": (estimator.taken - 1) / used if used > 0.0 else None,
        "accel_sign": info.accel_sign,
        "mount": info.mount,
        "measurements": info.measurements,
        "seed": info.seed if info.measurements == "drawn" else None,
        "spread": _spread(estimator, info, readings["health"]),
        "history_known": bool(info.memory),
        "gaps": [{"t": t, "seconds": seconds} for t, seconds in estimator.gaps],
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


def _spread(estimator: "Estimator", info: SessionInfo, health: Sequence[HealthEntry]) -> SpreadFields | None:
    moments = estimator.after_convergence
    if moments is None or estimator.reference is None:
        return None
    seen = seen_axes(estimator, info.axes()) & has_readings(health)
    mean = estimator.reference.start()[0].plus(moments.mean)
    sd = sd_columns(moments.covariance, mean.C_nb, info, seen)
    return {"mean": fields(state_columns(mean, info, seen)), "sd": fields(sd)}
