"""What a motion will let be told, before it is made: effects and biases that stand out of noise and of one another.

For a motion, white noise of the specification, and parameters θ of all effects at once, each plausibly as large as its
prior p says,

    d_j² = 1 / [(I + Σ_c P W_cᵀ W_c P)⁻¹]_jj - 1,   W_c the columns on channel c over its noise, P = diag(p)

is how far a plausible θ_j is from all that noise and plausible sizes of the others could make of it, in standard
deviations. The constant bias is one of them. With d ≥ 2 an effect counts as testable.

What it leaves out: effects of time and temperature, which no table moves; mounting and gravity, which are among
misalignment and scale factor here; what to call all that (`imutui.jobs.operator_steps`).
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from filters.effects import additive, reference_errors
from filters.effects.hypothesis import ACCELS, GYROS, Hypothesis
from filters.imu import CHANNELS, IMU400CD_200, AxisMap, ImuSpec
from filters.motion.profile import Profile
from filters.motion.segments import Sine
from filters.state import PAPER_SITE, Site
from filters.tracing import residual
from filters.tracing.design_matrix import Atom, Stack, columns_on
from filters.tracing.residual import Run
from filters.types import Array

TESTABLE = 2.0
"""A d of this makes an effect testable."""
BIAS = "bias"

_HZ, _PER_PERIOD = 10.0, 20.0
_BLOCK_S = 0.5
_MOST_SAMPLES = 400_000


@dataclass(frozen=True, slots=True)
class Quantity:
    """A parameter of an effect.

    Attributes
    ----------
    effect : str
        "bias", or its name in the catalogue.
    channel : str
        Such as "az"; empty where channels share it.
    axis : str
        What it is along, such as "z"; empty where it is not along anything.
    """

    effect: str
    channel: str
    axis: str


@dataclass(frozen=True)
class _Column:
    """A quantity with its plausible size (SI) and its regressors on the channels that it acts on."""

    quantity: Quantity
    prior: float
    on: dict[int, Array]


def told(
    profile: Profile, spec: ImuSpec = IMU400CD_200, axes: AxisMap | None = None, site: Site = PAPER_SITE
) -> list[dict[Quantity, float]]:
    """How well each quantity is told after each segment.

    Parameters
    ----------
    profile : Profile
        Made as it is written. Joined by marks, it counts at rest only.
    spec : ImuSpec
        White noise and limits of the biases.
    axes : AxisMap or None
        How the unit sits; by default as the table's axes.
    site : Site
        Where.

    Returns
    -------
    list of dict
        For each segment d of each quantity, from all segments up to it.
    """
    stack, segment = _stack(profile, axes or AxisMap(), site)
    sd = np.repeat([spec.gyro_arw, spec.accel_vrw], 3) / np.sqrt(stack.period)
    columns = list(_columns(stack, spec))
    information = np.zeros((len(columns), len(columns)))
    made = []
    for number in range(len(profile.segments)):
        information += _information(columns, sd, segment == number)
        own = np.diag(np.linalg.inv(np.eye(len(columns)) + information))
        d = np.sqrt(np.maximum(1.0 / own - 1.0, 0.0))
        made.append({column.quantity: float(value) for column, value in zip(columns, d, strict=True)})
    return made


def _stack(profile: Profile, axes: AxisMap, site: Site) -> tuple[Stack, NDArray[np.int_]]:
    """The motion in blocks, and the segment that each counts for; -1 for none."""
    fastest = max((s.hz for s in profile.segments if isinstance(s, Sine)), default=0.0)
    hz = min(max(_HZ, _PER_PERIOD * fastest), _MOST_SAMPLES / profile.duration)
    t = np.arange(max(2, round(profile.duration * hz))) / hz
    run = Run("", t, np.zeros((t.size, 6)), None, profile.angles(t), profile.rates(t), axes, site)
    stack = Stack.of([residual.blocks(run, max(_BLOCK_S, 1.0 / hz))])
    segment = profile.index(stack.t)
    if profile.align == "marks":
        half = 0.5 * stack.period
        segment = np.where(profile.phase(stack.t - half) & profile.phase(stack.t + half), segment, -1)
    return stack, segment


def _columns(stack: Stack, spec: ImuSpec) -> Iterator[_Column]:
    for c, name in enumerate(CHANNELS):
        limit = spec.gyro_bias_limit if c in GYROS else spec.accel_bias_limit
        yield _Column(Quantity(BIAS, name, ""), limit, {c: np.ones(stack.t.size)})
    atoms = [Atom(h, dict.fromkeys(h.channels, np.arange(len(h.parameters())))) for h in _effects()]
    columns = columns_on(stack, atoms)
    for atom in atoms:
        h = atom.hypothesis
        channel = CHANNELS[h.channels[0]] if len(h.channels) == 1 else ""
        for k, parameter in enumerate(h.parameters()):
            axis = parameter.name if len(h.parameters()) > 1 else str(h.shape().get("axes", ""))
            on = {c: columns[atom.key, c][:, k] for c in h.channels}
            yield _Column(Quantity(h.effect, channel, axis), parameter.prior * parameter.si, on)


def _effects() -> Iterator[Hypothesis]:
    """Those that motion shows, each with all its parameters."""
    for c in (*GYROS, *ACCELS):
        yield additive.Scale(c)
        yield additive.CrossAxis(c)
        if c in GYROS:
            yield additive.GSensitivity(c)
            yield additive.NonlinearityQuadratic(c)
        else:
            yield additive.GSquared(c, c - 3)
        yield additive.Asymmetry(c)
        yield additive.NonlinearityCubic(c)
    yield from (
        reference_errors.Tilt(),
        reference_errors.LeverArm(),
        reference_errors.Delay(),
        reference_errors.EarthRate(),
    )


def _information(columns: list[_Column], sd: Array, rows: NDArray[np.bool_]) -> Array:
    """P Wᵀ W P of some rows, all channels."""
    out = np.zeros((len(columns), len(columns)))
    for c in range(len(CHANNELS)):
        here = [n for n, column in enumerate(columns) if c in column.on]
        W = np.stack([columns[n].on[c][rows] * columns[n].prior for n in here], axis=1) / sd[c]
        out[np.ix_(here, here)] += W.T @ W
    return out
