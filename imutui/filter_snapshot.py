"""What is seen of a running filter: the shapes of its part of an acquisition's snapshot, which verdicts are made of.

Records only, as they travel over the socket (JSON objects). Times are seconds; biases are in the instrument's own axes
and sign. None stands for what is not known.
"""

from typing import TypedDict


class BiasSnapshot(TypedDict):
    """A bias: three standard deviations, the data sheet's limit, change over 10 s, when it converged.

    `site_sd3` is the part of `sd3`, in quadrature, that comes from a site that is not stated. `limit` is None for a
    unit whose data sheet is not known.
    """

    name: str
    value: float | None
    sd3: float | None
    site_sd3: float
    unit: str
    limit: float | None
    change_10s: float | None
    converged_s: float | None
    observable: bool


class NisSnapshot(TypedDict):
    """Mean normalised innovation squared with its 95 % band, and whether it is a test."""

    mean: float | None
    first: float | None
    dof: float
    band95: list[float | None]
    is_test: bool
    why: str


class RemainderSnapshot(TypedDict):
    """What the model leaves unexplained on a channel: means of 10 s over what noise allows, of so many windows."""

    channel: str
    ratio: float | None
    windows: int


class NoiseSnapshot(TypedDict):
    """Gyros or accelerometers, whichever are noisier over what the filter takes for their white noise: how many times.

    `relative_sd` is the standard deviation of `ratio`, as a part of it.
    """

    name: str
    ratio: float
    relative_sd: float


class CauseSnapshot(TypedDict):
    """An effect that the residual of a unit at rest showed while it was filtered, instrument axes.

    `effect` is the catalogue's name. `size` and `sd` are in `unit`, of a noise_level a ratio without one. `odds` are
    against all else that is considered. `since` is when a step, telegraph or noise_level began, when another was first
    seen, `t` when it was last seen, or withdrawn, s since the first sample. `extent` is how far it takes the reading
    from its mean, deg/s or mg, 0 of a noise_level. `shows`: whether it shows now.
    """

    channel: str
    effect: str
    size: float
    sd: float
    unit: str
    odds: float
    since: float
    extent: float
    t: float
    hz: float | None
    shows: bool
    text: str


class EffectSnapshot(TypedDict):
    """Estimated state of an effect that joined the filter, in the unit of its file."""

    label: str
    value: float
    sd: float
    unit: str


class NavigationSnapshot(TypedDict):
    """Navigation states, in the units of their names."""

    position_deg_m: list[float]
    velocity_mps: list[float]
    rpy_deg: list[float]


class NavigationSdSnapshot(TypedDict):
    """Standard deviations of the navigation states."""

    position_m: list[float]
    velocity_mps: list[float]
    rpy_deg: list[float | None]


class FilterSnapshot(TypedDict):
    """The filter; `t` of its last sample, `waiting` what it waits for, in words.

    From `held_since` on there is no reference any more: biases are held, and there is no navigation state.
    `limits_of` is where the limits of biases are from.
    `causes` stand, `causes_gone` were told and withdrawn, the newest first.
    `departure` says where in a table profile the readings depart from the model most certainly, and what it may be.
    """

    name: str
    reference: str
    t: float | None
    samples: int
    waiting: str | None
    converged: bool
    temperature_k_per_min: float | None
    held_since: float | None
    departure: str | None
    limits_of: str
    biases: list[BiasSnapshot]
    nis: NisSnapshot
    remainder: list[RemainderSnapshot]
    noise: NoiseSnapshot | None
    causes: list[CauseSnapshot]
    causes_gone: list[CauseSnapshot]
    effects: list[EffectSnapshot]
    state: NavigationSnapshot | None
    state_sd: NavigationSdSnapshot | None
    alarms: list[str]
    failure: str | None
    rejected: int
    confounded: list[str]
