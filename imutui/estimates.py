"""What a filter has come to: one record, of a filter that runs, of a run that is over, in a row, and for the verdict.

`imutui.logbook.results` fills it; a snapshot of a running acquisition holds it, and a result is it with its provenance.
The names are those of the public JSON (docs/formats.md). Times are s since the first sample. Biases are in the
instrument's own axes and sign, gyros in deg/s and accelerometers in mg. None stands for what is not known.
"""

from typing import Annotated, Literal, NamedTuple, TypeAlias, TypedDict, final

from filters import specification
from filters.channels import DPS, MG
from filters.specification import ImuSpec
from filters.tracing.trace_document import IdentityEntry

Three: TypeAlias = Annotated[list[float | None], 3]


class BiasFields(TypedDict):
    """Something of each bias, in the units of the names; None where the bias cannot be seen."""

    accel_bias_mg: Three
    gyro_bias_dps: Three


class StateFields(BiasFields):
    """Navigation state and biases, in the units of their names."""

    position_deg_m: Three
    velocity_mps: Three
    rpy_deg: Three


class SdFields(BiasFields):
    """Standard deviations that go with `StateFields`; of the position in metres north, east, down."""

    position_m: Three
    velocity_mps: Three
    rpy_deg: Three


class ConvergedFields(TypedDict):
    """When each bias converged; None where it has not."""

    accel_bias: Three
    gyro_bias: Three


class MeanNis(TypedDict):
    """Mean normalised innovation squared with its 95 % band, and whether it is a test."""

    mean: float | None
    dof: float
    band95: Annotated[list[float | None], 2]
    is_test: bool


class NisFields(MeanNis):
    """The same with the first one, and why it is a test or none."""

    first: float | None
    why: str


class WhiteNoise(TypedDict):
    """Angle and velocity random walk, instrument axes."""

    gyro_arw_deg_sqrt_h: Three
    accel_vrw_mps_sqrt_h: Three


class ProcessNoise(WhiteNoise):
    """What the filter takes for noise: white, and walks of the biases; `source` is where it comes from."""

    source: str
    gyro_walk_dps_sqrt_h: Three
    accel_walk_mps2_sqrt_h: Three


class MeasuredNoise(WhiteNoise):
    """White noise measured on the samples, and its standard deviation as a share of it."""

    relative_sd: float | None


class NoiseFields(MeasuredNoise):
    """The same beside the specification's and the filter's own."""

    specification: WhiteNoise
    used: ProcessNoise


class EffectField(TypedDict):
    """State of an effect that joined the filter; `name` ends with its unit in parentheses."""

    name: str
    value: float
    sd: float


class RemainderField(TypedDict):
    """What the model leaves unexplained on a channel: means of 10 s over what noise allows, of so many windows."""

    channel: str
    ratio: float | None
    windows: int


class CauseField(TypedDict):
    """An effect that the residual of a unit at rest showed while it was filtered, instrument axes.

    `effect` is the catalogue's name. `size` and `sd` are in `unit`; those of a noise_level are ratios without one.
    `odds` are against all else that is considered. `since` is when a step, telegraph or noise_level began, or when
    another effect was first seen. `t` is when it was last seen, or withdrawn. `extent` is how far it takes the reading
    from its mean, deg/s or mg, 0 for a noise_level. `shows`: whether it shows now.
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


class RunFields(TypedDict):
    """What is known of every run of samples, whether a filter runs or not."""

    filter: str
    samples: int
    alarms: list[str]
    identity: IdentityEntry


class Estimates(RunFields):
    """What a filter has come to, at any instant; before the first sample it has used, `samples` is 0."""

    duration_s: float
    reference: str
    unobservable: list[str]
    final: StateFields
    sd: SdFields
    site_stated: bool
    site_sd_mg: Annotated[list[float], 3]
    """What an unstated site adds, in quadrature, to `sd` of the accelerometer biases."""
    converged: bool
    converged_s: ConvergedFields
    nis: NisFields
    noise: NoiseFields
    effects: list[EffectField]
    rejected: int
    confounded: list[str]
    remainder: list[RemainderField]
    temperature_k_per_min: float | None
    held_since_s: float | None
    """When the reference ended: from then on biases are held, and navigation states are those of then."""
    causes: list[CauseField]
    causes_gone: list[CauseField]
    """Effects that the residual of a unit at rest showed: those that stand, and those that were withdrawn."""
    departure: str | None
    """With a table profile: where the readings depart from the model most certainly, in a sentence."""


@final
class FilterSnapshot(Estimates):
    """The filter of a running acquisition: why it stopped or waits, in words, and the change of biases over 10 s."""

    failure: str | None
    waiting: str | None
    change_10s: BiasFields


class Bias(NamedTuple):
    """One of the six biases. `value` and `sd` are None while it has no estimate, and where it cannot be seen."""

    name: str  # such as "x gyro"
    channel: str  # gx to az
    unit: str
    key: Literal["gyro_bias_dps", "accel_bias_mg"]
    place: int  # in the fields of that name
    value: float | None
    sd: float | None
    site_sd: float  # part of `sd`, in quadrature, that an unstated site adds
    limit: float | None  # of the data sheet; None where none is known
    change_10s: float | None
    converged_s: float | None
    observable: bool

    def of(self, fields: BiasFields) -> float | None:
        """Return what fields say of this bias: its truth, or its mean."""
        return fields[self.key][self.place]

    @property
    def sd3(self) -> float | None:
        """Three standard deviations."""
        return None if self.sd is None else 3.0 * self.sd


_KINDS: tuple[tuple[str, str, Literal["gyro_bias_dps", "accel_bias_mg"], Literal["gyro_bias", "accel_bias"]], ...] = (
    ("gyro", "deg/s", "gyro_bias_dps", "gyro_bias"),
    ("accel", "mg", "accel_bias_mg", "accel_bias"),
)
NAMES = tuple(f"{axis} {kind}" for kind, *_ in _KINDS for axis in "xyz")
"""Names of biases, in the order of `biases`."""


def biases(of: Estimates, change: BiasFields | None = None) -> list[Bias]:
    """Return the biases of gyros, then accelerometers.

    `change`: over 10 s, of a filter that runs.
    """
    limits, site, since = bias_limits(specification_of(of)), of["site_sd_mg"], of["converged_s"]
    return [
        Bias(
            f"{axis} {kind}", f"{kind[0]}{axis}", unit, key, i, of["final"][key][i], of["sd"][key][i],
            site[i] if kind == "accel" else 0.0, limits[unit], None if change is None else change[key][i],
            since[known][i], f"{known}_{axis}" not in of["unobservable"],
        )
        for kind, unit, key, known in _KINDS for i, axis in enumerate("xyz")
    ]  # fmt: skip


def live_biases(of: FilterSnapshot) -> list[Bias]:
    """Return the biases of a filter that runs, with their change over 10 s."""
    return biases(of, of["change_10s"])


def specification_of(of: RunFields) -> ImuSpec:
    """Return the specification of the unit; `NOT_KNOWN` of one that is not stated."""
    return specification.of_model(of["identity"]["instrument"])


def bias_limits(spec: ImuSpec) -> dict[str, float | None]:
    """Return the limits of biases by their unit, deg/s and mg; None where no data sheet is known."""
    if spec == specification.NOT_KNOWN:
        return {"deg/s": None, "mg": None}
    return {"deg/s": round(spec.gyro_bias_limit / DPS, 9), "mg": round(spec.accel_bias_limit / MG, 9)}
