"""What a log is too quiet or too short to show: the smallest size of an effect, and what a motion lets be told.

Of a log (`limits`): detectability d = 5, d the size of an effect over what white noise makes of it.

Of a motion, before it is made (`of_motion`): white noise of the specification, and parameters θ of all effects at once,
each plausibly as large as its prior p says,

    d_j² = 1 / [(I + Σ_c P W_cᵀ W_c P)⁻¹]_jj - 1,   W_c the columns on channel c over its noise, P = diag(p)

is how far a plausible θ_j is from all that noise and plausible sizes of the others could make of it, in standard
deviations. The constant bias is one of them. With d ≥ 2 an effect counts as testable.

What it leaves out: of a motion, effects of time and temperature, which no table moves; mounting and gravity, which are
among misalignment and scale factor there; what to call all that (`imutui.jobs.operator_steps`).
"""

from collections.abc import Collection, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from filters.channels import ACCELS, CHANNELS, GYROS, error_unit
from filters.effects import deterministic
from filters.effects.catalogue import EFFECTS
from filters.effects.hypothesis import Hypothesis
from filters.imu import IMU400CD_200, AxisMap, ImuSpec
from filters.motion.profile import Profile
from filters.motion.segments import Sine
from filters.state import PAPER_SITE, Site
from filters.tracing.blocks import average
from filters.tracing.columns import Term, columns_on
from filters.tracing.design_matrix import Design
from filters.tracing.run import Run
from filters.tracing.stack import Stack
from filters.tracing.trace_document import LimitEntry
from filters.types import Array

DETECTABLE = 5.0  # a d of this is detected in a log
TESTABLE = 2.0  # a d of this makes an effect testable by a motion
BIAS = "bias"

_HZ, _PER_PERIOD = 10.0, 20.0
_BLOCK_S = 0.5
_MOST_SAMPLES = 400_000

# ------------------------------------------------------------------------------------------------- of the runs at hand


def limits(design: Design, channels: list[int], effect: str, found: Collection[object]) -> list[LimitEntry]:
    """Limits of one effect.

    `effect`: in the catalogue.
    `found`: keys of the terms that were found: they need no limit.
    Returns a deterministic effect of several parameters has a limit for each. One without limit where the log can't
      show the effect at all, or it has no size to be too small.
    """
    if EFFECTS[effect].kind in ("run_specific", "drift"):
        return [_of_process(design, c, effect) for c in channels]
    terms = [a for a in design.terms if a.hypothesis.effect == effect and set(a.places) & set(channels)]
    faint = [a for a in terms if a.key not in found]
    made = [entry for term in faint for entry in _of_term(design, term)]
    if made or (terms and not faint) or EFFECTS[effect].kind not in ("additive", "motion"):
        return made
    text = "this log can't show it, whatever its size"
    return [{"effect": effect, "channels": [], "limit": None, "unit": "", "text": text}]


def _of_term(design: Design, term: Term) -> list[LimitEntry]:
    """Limit of each parameter, the others being nothing."""
    h = term.hypothesis
    out = []
    for k, p in enumerate(h.parameters):
        information = sum(float(design.gram(c)[0][places[k], places[k]]) for c, places in term.places.items())
        raw = max(float(design.raw[places[k]]) for places in term.places.values())
        if information <= 1e-9 * raw**2 * design.stack.t.size:
            continue
        limit = DETECTABLE / float(np.sqrt(information)) / p.si
        shape = [f"{name} {value}" for name, value in h.shape.items()]
        words = ", ".join([p.name, *shape] if term.size > 1 else shape)
        out.append(_entry(h.effect, [CHANNELS[c] for c in h.channels], limit, p.unit, words))
    return out


def _of_process(design: Design, c: int, effect: str) -> LimitEntry:
    """Limit of a tone's amplitude, of a jump halfway, of a drift's level, from length and white density alone."""
    stack = design.stack
    total = stack.seconds(c)
    run = total / stack.begins.size
    white = float(design.sd[c]) * float(np.sqrt(stack.period))
    unit, si = error_unit(c)
    size, words = {
        "tone": (np.sqrt(2.0 / total), "amplitude"),
        "step": (2.0 / np.sqrt(run), "halfway through a run"),
        "telegraph": (2.0 / np.sqrt(total), "as often up as down"),
        "gauss_markov": (1.0 / np.sqrt(total), "standard deviation, slow against a run"),
        "random_walk": (np.sqrt(6.0) / run, "in a run"),
    }[effect]
    own = f"{unit}/√s" if effect == "random_walk" else unit
    return _entry(effect, [CHANNELS[c]], DETECTABLE * white * float(size) / si, own, words)


def _entry(effect: str, channels: list[str], limit: float, unit: str, words: str) -> LimitEntry:
    said = f" {unit}" if unit != "1" else ""
    text = f"below what this log can show (limit {limit:.3g}{said}{', ' + words if words else ''})"
    return {"effect": effect, "channels": channels, "limit": limit, "unit": unit, "text": text}


# ---------------------------------------------------------------------------------------------------- of a motion


@dataclass(frozen=True, slots=True)
class Quantity:
    """A parameter of an effect."""

    effect: str  # "bias", or its name in the catalogue
    channel: str  # such as "az"; empty where channels share it
    axis: str  # what it is along, such as "z"; empty where it is not along anything


@dataclass(frozen=True)
class _Column:
    """A quantity with its plausible size (SI) and its regressors on the channels that it acts on."""

    quantity: Quantity
    prior: float
    on: dict[int, Array]


def of_motion(
    profile: Profile, spec: ImuSpec = IMU400CD_200, axes: AxisMap | None = None, site: Site = PAPER_SITE
) -> list[dict[Quantity, float]]:
    """How well each quantity is told after each segment.

    `profile`: made as it is written. Joined by marks, it counts at rest only.
    `spec`: white noise and limits of the biases.
    `axes`: how the unit sits; by default as the table's axes.
    Returns for each segment d of each quantity, from all segments up to it.
    """
    stack, segment = _stack(profile, axes or AxisMap(), site)
    sd = np.repeat([spec.gyro_arw, spec.accel_vrw], 3) / np.sqrt(stack.period)
    columns = list(_columns(stack, spec))
    of_channel = [_weighted(columns, sd, c) for c in range(len(CHANNELS))]
    information = np.zeros((len(columns), len(columns)))
    made: list[dict[Quantity, float]] = []
    for rows in _rows_of_segments(segment, len(profile.segments)):
        if made and not rows.size:
            made.append(made[-1])
            continue
        for here, W in of_channel:
            information[np.ix_(here, here)] += W[rows].T @ W[rows]
        own = np.diag(np.linalg.inv(np.eye(len(columns)) + information))
        d = np.sqrt(np.maximum(1.0 / own - 1.0, 0.0))
        made.append({column.quantity: float(value) for column, value in zip(columns, d, strict=True)})
    return made


def _rows_of_segments(segment: NDArray[np.int_], count: int) -> list[NDArray[np.int_]]:
    """Rows of each of so many segments; the rows of a profile of many are looked through once."""
    order = np.argsort(segment, kind="stable")
    return np.split(order, np.searchsorted(segment[order], np.arange(count + 1)))[1:-1]


def _stack(profile: Profile, axes: AxisMap, site: Site) -> tuple[Stack, NDArray[np.int_]]:
    """The motion in blocks, and the segment that each counts for; -1 for none."""
    fastest = max((s.hz for s in profile.segments if isinstance(s, Sine)), default=0.0)
    hz = min(max(_HZ, _PER_PERIOD * fastest), _MOST_SAMPLES / profile.duration)
    t = np.arange(max(2, round(profile.duration * hz))) / hz
    run = Run(
        name="",
        t=t,
        reading=np.zeros((t.size, 6)),
        temperature=None,
        angles=profile.angles(t),
        rates=profile.rates(t),
        axes=axes,
        site=site,
    )
    stack = Stack.of([average(run, max(_BLOCK_S, 1.0 / hz))])
    segment = profile.index(stack.t)
    if profile.align == "marks":
        half = 0.5 * stack.period
        segment = np.where(profile.phase(stack.t - half) & profile.phase(stack.t + half), segment, -1)
    return stack, segment


def _columns(stack: Stack, spec: ImuSpec) -> Iterator[_Column]:
    for c, name in enumerate(CHANNELS):
        limit = spec.gyro_bias_limit if c in GYROS else spec.accel_bias_limit
        yield _Column(Quantity(BIAS, name, ""), limit, {c: np.ones(stack.t.size)})
    terms = [Term(h, dict.fromkeys(h.channels, np.arange(len(h.parameters)))) for h in _effects()]
    columns = columns_on(stack, terms)
    for term in terms:
        h = term.hypothesis
        channel = CHANNELS[h.channels[0]] if len(h.channels) == 1 else ""
        for k, parameter in enumerate(h.parameters):
            axis = parameter.name if len(h.parameters) > 1 else str(h.shape.get("axes", ""))
            on = {c: columns[term.key, c][:, k] for c in h.channels}
            yield _Column(Quantity(h.effect, channel, axis), parameter.prior * parameter.si, on)


def _effects() -> Iterator[Hypothesis]:
    """Those that motion shows, each with all its parameters."""
    for c in (*GYROS, *ACCELS):
        yield deterministic.scale(c)
        yield deterministic.cross_axis(c)
        if c in GYROS:
            yield deterministic.g_sensitivity(c)
            yield deterministic.nonlinearity_quadratic(c)
        else:
            yield deterministic.g_squared(c, c - 3)
        yield deterministic.asymmetry(c)
        yield deterministic.nonlinearity_cubic(c)
    yield from (deterministic.tilt(), deterministic.lever_arm(), deterministic.delay(), deterministic.earth_rate())


def _weighted(columns: list[_Column], sd: Array, channel: int) -> tuple[list[int], Array]:
    """Numbers of the columns that act on a channel, and W P of them, shape (n, columns)."""
    here = [n for n, column in enumerate(columns) if channel in column.on]
    W = np.stack([columns[n].on[channel] * columns[n].prior for n in here], axis=1) / sd[channel]
    return here, W
