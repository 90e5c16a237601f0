"""Recordings of a table that turns, and a hand-made result of a trace, for the tests of what is around the tracer."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from filters import earth
from filters.effects.records import Included, State
from filters.imu import STANDARD_GRAVITY, AxisMap
from filters.motion import kinematics
from filters.motion.profile import Profile
from filters.motion.segments import Dwell
from filters.state import PAPER_SITE
from filters.tracing.result import RunSeries, SeparatingExperiment, Trace
from filters.tracing.trace_document import CommonEntry, RunEntry, TraceDocument, TraceFindings
from helpers.shapes import whole
from imutui.jobs import residuals
from imutui.logbook import import_reference
from imutui.logbook.importing import recording as recordings
from imutui.logbook.importing.table import Asked
from imutui.logbook.importing.write import write
from imutui.logbook.results import ResultDocument
from imutui.logbook.session_info import SessionInfo

PROFILE = '[[segment]]\nkind = "dwell"\nangles_deg = [0.0, 0.0, 0.0]\nseconds = 60.0\n'


def tumble(t: np.ndarray, *, moving: bool = True) -> tuple[np.ndarray, np.ndarray]:
    """Angles (deg) and rates (deg/s): a dwell, slow swings about two axes, turns about the third."""
    on = np.clip((t - 20.0) / 5.0, 0.0, None) if moving else np.zeros_like(t)
    w = 2.0 * np.pi * np.array([0.05, 0.08])
    angles = np.stack([30.0 * (1 - np.cos(w[0] * on)), 20.0 * (1 - np.cos(w[1] * on)), 3.0 * on**2 / (1 + on)], axis=1)
    slope = (t > 20.0) / 5.0 * moving
    rates = np.stack(
        [30 * w[0] * np.sin(w[0] * on), 20 * w[1] * np.sin(w[1] * on), 3 * (on**2 + 2 * on) / (1 + on) ** 2], axis=1
    )
    return angles, rates * slope[:, None]


def readings(t: np.ndarray, angles: np.ndarray, rates: np.ndarray, axes: AxisMap) -> tuple[np.ndarray, np.ndarray]:
    """What a perfect unit reads: deg/s and g, instrument axes and sign."""
    a, r = np.deg2rad(angles), np.deg2rad(rates)
    C = kinematics.attitudes(a)
    w = kinematics.body_rate(a, r) + np.einsum("nij,i->nj", C, earth.earth_rate_n(np.array(PAPER_SITE.latitude)))
    f = -PAPER_SITE.gravity * C[:, 2]
    return np.rad2deg(axes.gyro_to_instrument(w)), axes.accel_to_instrument(f) / STANDARD_GRAVITY


def arrays(
    seconds: float = 90.0, hz: float = 20.0, sign: int = -1, *, moving: bool = True, seed: int | None = None
) -> dict[str, np.ndarray]:
    """Arrays of a perfect unit's recording, with noise if there is a seed."""
    t = np.arange(int(seconds * hz) + 1) / hz
    angles, rates = tumble(t, moving=moving)
    gyro, accel = readings(t, angles, rates, AxisMap(accel_sign=sign))
    if seed is not None:
        rng = np.random.default_rng(seed)
        gyro = gyro + rng.normal(size=gyro.shape) * 0.05
        accel = accel + rng.normal(size=accel.shape) * 1e-3
    return {"t": t, "gyro": gyro, "accel": accel, "temp": 25.0 + 4.0 * np.sin(t / 40.0), "ang": angles, "rate": rates}


def imported(path: Path, given: dict[str, np.ndarray], **info: Any) -> Path:
    """A log of such arrays, as `imutui import` makes it."""
    source = path.with_suffix(".npz")
    np.savez(source, **given)
    session = SessionInfo(**({"instrument": ""} | info))
    # the units are stated: some of these recordings contradict them
    recording = recordings.load(source, Asked(units="t:s,gyro:deg/s,accel:g,temp:degC"))
    reference = import_reference.from_arrays(recording.known_t, recording.known, session.axes().mount)
    if reference is not None:
        session = SessionInfo(**({"instrument": ""} | info | {"reference": reference.kind}))
    write(recording, session, path, overwrite=True, reference=reference)
    return path


RUN: dict[str, Any] = whole(
    RunEntry, id="a", kind="simulated", rate_hz=20.0, seconds=900.0, reference="level", accel_sign=-1, mount="x,y,z"
)
COMMON = whole(CommonEntry, {
    "kind": "event", "label": "step together and come back", "channels": ["ax", "ay"], "coherence": 0.93,
    "t_start_s": 700.0, "t_end_s": 1000.0, "curve": {"t_s": [699.5, 700.5], "y": [0.01, 2.75]}, "unit": "mg",
    "sizes": [{"channel": "ax", "value": 2.75, "sd": 0.1, "unit": "mg"}], "p": 1e-9, "record": ["supply voltage"],
    "run": "a",
})  # fmt: skip
REPLAY = Path(__file__).with_name("replay_result.json")


def replayed(**changes: Any) -> dict[str, Any]:
    """A replay's result."""
    return dict(whole(ResultDocument, json.loads(REPLAY.read_text()), **changes))


def of_two_runs(**changes: Any) -> dict[str, Any]:
    """A trace's result, with a run that was held out."""
    runs = [RUN, {**RUN, "id": "b", "heldout": True}]
    found = {
        **document(),
        "runs": runs,
        "notes": ["a note"],
        "library": "imutui 1",
        "effects_file": "version = 1\n",
    } | changes
    return dict(whole(TraceDocument, found))


def document() -> dict[str, Any]:
    """What the tracer has found, with something of everything, and the experiment."""
    thermal = {
        "effect": "thermal_lin",
        "label": "bias follows temperature",
        "channels": ["gy"],
        "params": [{"name": "k", "value": 0.02, "sd": 0.001, "unit": "deg/s/K", "plausible": True}],
        "score": 812.0,
        "odds": 40.0,
        "gain": 830.0,
        "heldout_gain": 700.0,
        "share_of_excess": 0.971,
        "driver_curve": None,
        "proposed_form": None,
        "rivals": [
            {
                "effect": "thermal_rate",
                "label": "bias follows the rate of temperature",
                "score_difference": -3.0,
                "odds": 9.0,
            }
        ],
        "include_as": "A",
        "confirmed": True,
    }
    lever = {
        **thermal,
        "effect": "lever_arm",
        "label": "the accelerometers sit off the table's centre",
        "channels": ["ax", "ay", "az"],
        "params": [{"name": n, "value": 0.05, "sd": 0.002, "unit": "m", "plausible": n != "z"} for n in "xyz"],
        "rivals": [],
    }
    knots = [float(x) for x in range(6)]
    free = {
        **thermal,
        "effect": "driver:since_motion",
        "label": "error is a function of since_motion",
        "channels": ["az"],
        "params": [{"name": f"at {x}", "value": 0.1 * x, "sd": 0.1, "unit": "mg", "plausible": True} for x in knots],
        "rivals": [],
        "proposed_form": "tanh",
        "confirmed": False,
        "driver_curve": {
            "driver": "since_motion", "unit": "s", "x": knots, "y": knots, "sd": [0.1] * 6, "y_unit": "mg",
        },
    }  # fmt: skip
    error = {
        "metric": "e10", "channel": "gy", "unit": "deg/s", "before": 0.084, "after": 0.0101, "floor": 0.01,
        "before_x_floor": 8.41, "after_x_floor": 1.01, "ci95": [0.009, 0.011], "floor_band95": [0.0085, 0.0117],
        "n": 84, "heldout": "run",
    }  # fmt: skip
    found = {
        "version": 1,
        "untestable": [
            {"effect": "scale", "reason": "equals_bias"},
            {"effect": "scale", "reason": "equals_bias"},
            {"effect": "g_squared", "reason": "equals_bias"},
            {"effect": "gravity", "reason": "collinear_with", "with": "scale", "rho": 1.0},
        ],
        "integrity": [{"effect": "spikes", "channels": ["gx"], "count": 3, "where": "12.5 s of run a"}],
        "lines": [{"channels": ["ax", "ay"], "hz": 31.41, "width_hz": 0.1, "rms": 0.4, "unit": "mg"}],
        "noise_level": [{"channels": ["gz"], "driver": "rate_norm", "ratio": 1.6}],
        "findings": [thermal, lever, free],
        "refuted": [],
        "common": [],
        "weak": [{"effect": "ramp", "label": "bias drifts evenly", "channels": ["gx"], "params": [], "score": 11.0}],
        "drift": [{"channels": ["gx"], "kind": "gauss_markov", "tau_s": 80.0, "level": 0.004, "unit": "deg/s"}],
        "remainder": [{"channel": "ax", "scale_s": 16.0, "ratio": 1.42, "p": 1e-7}],
        "status": {
            "gx": "stochastic", "gy": "confounded", "gz": "clean", "ax": "partial", "ay": "explained",
            "az": "unexplained",
        },
        "separating_experiment": {
            "a": "thermal_lin", "b": "thermal_rate", "profile": PROFILE, "duration_s": 1800.0, "d_expected": 42.0,
        },
        "error": [error, {**error, "metric": "nis", "unit": "", "before": 1.84, "after": 1.0, "floor": 1.0}],
        "limits": [],
        "sentence": "Temperature explains most of gy; one cause of az is not told.",
        "seed": 0,
    }  # fmt: skip
    return dict(whole(TraceFindings, found))


EXPERIMENT = SeparatingExperiment(
    a="thermal_lin",
    b="thermal_rate",
    profile=Profile((Dwell((0.0, 0.0, 0.0), 60.0),)),
    thermal=None,
    duration_s=1800.0,
    d_expected=42.0,
    motion="",
    leaves=(),
)
"""The separating experiment of `document`, as the tracer gives it."""


def trace(names: tuple[str, ...] = ("a", "b")) -> Trace:
    rng = np.random.default_rng(3)
    t = np.arange(600) * 0.25
    series = []
    for name in names:
        before = rng.normal(size=(600, 6)) * 1e-3
        before[:20, 2] = np.nan
        series.append(RunSeries(name, 0.25, t, before, 0.5 * before))
    included = (
        Included("thermal_lin", ("gy",), "A", {"reference_degc": 25.0}, (State("k", "deg/s/K", 0.02, 0.001),)),
        Included("gauss_markov", ("gx",), "S", {}, (State("b", "deg/s", 0.0, 0.004, 80.0, 6e-4),)),
    )
    found = {key: value for key, value in document().items() if key not in ("version", "separating_experiment")}
    return Trace(found, included, np.array([[1.0, 0.1], [0.1, 1.0]]), tuple(series), EXPERIMENT)


def nothing(names: tuple[str, ...] = ("a",)) -> Trace:
    """A clean unit's result."""
    status = dict.fromkeys(("gx", "gy", "gz", "ax", "ay", "az"), "clean")
    return Trace(
        whole(TraceFindings, status=status, sentence="Nothing found."), (), np.empty((0, 0)), trace(names).series
    )


def whole_document() -> dict[str, Any]:
    """`document` with every field that a trace's JSON has, of two runs, as a file of results holds it."""
    run = {**RUN, "log": "/data/a.mcap", "samples": 18_001, "power_on": "p", "log_sha256": "ab" * 32}
    runs = [run, {**run, "id": "b", "log": "/data/b.mcap", "heldout": True, "power_on": "q"}]
    return of_two_runs(runs=runs, curves=residuals.curves(trace(("b",)).series, "b"))
