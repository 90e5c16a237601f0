"""What a fleet's summary says, `imutui campaign --summary --json`; records only.

Biases are in the instrument's axes and sign, deg/s and mg. Simulated and measured logs, and models of instrument, are
in groups of their own, and no figure rests on two of them.
"""

from typing import Literal, TypedDict

Kind = Literal["measured", "simulated", "unknown"]
DriftVerdict = Literal["drift", "temperature", "drift_or_temperature", "none", "too_few", "no_times"]
Quantity = Literal["bias", "noise"]
LimitVerdict = Literal["fails", "not_told"]
Level = Literal["model", "some_units", "unit", "day", "not_told"]

MONTH_DAYS = 30.4375  # days of a month: a twelfth of 365.25


class EstimateField(TypedDict):
    """Value, the sd that 68 % lie within, and the ends of the interval that holds 95 %."""

    value: float
    sd: float
    low: float
    high: float


class ComponentField(TypedDict):
    """A standard deviation with its interval of 95 %, `low` 0 where it is not told from none; degrees of freedom."""

    sd: float
    low: float
    high: float
    dof: int


class PartsField(TypedDict):
    """A value as model, unit and day, see `filters.fleet.components.Fleet`; None where not determined."""

    model: EstimateField | None
    between_units: ComponentField | None
    between_power_ons: ComponentField | None
    together: ComponentField | None


class RepeatField(TypedDict):
    """Whether logs of one power-on agree; `scale` is what their standard deviations were multiplied by."""

    chi2: float
    dof: int
    p: float
    scale: float


class DriftField(TypedDict):
    """Whether a unit's bias changes over months; slopes in the channel's unit a month, and a kelvin."""

    verdict: DriftVerdict
    per_month: EstimateField | None
    p: float | None
    p_holm: float | None
    per_kelvin: EstimateField | None
    per_month_alone: EstimateField | None


class PointField(TypedDict):
    """A power-on in a control chart: when it began, its first log, value and sd, limits (None without), day's part."""

    power_on: str
    log: str
    logs: int
    start_utc: str | None
    temperature_degc: float | None
    converged: bool
    value: float
    sd: float
    low: float | None
    high: float | None
    outside: bool
    day: EstimateField | None


class UnitChannelField(TypedDict):
    """A unit's bias in one channel: value that its days scatter about, the same less the model's, drift, chart."""

    serial_number: str
    power_ons: int
    value: EstimateField | None
    own: EstimateField | None
    drift: DriftField
    centre: float | None
    points: list[PointField]


class ChannelField(PartsField):
    """Biases of one channel in all units of a group.

    `undetermined` says in sentences which parts are not told apart; `unobservable` logs had no such bias, in
    `unmeasured` ones the filter had hardly improved on its first guess, and in `unconverged` ones, which are used, the
    estimate had not settled.
    """

    channel: str
    unit: str
    logs: int
    unobservable: int
    unmeasured: int
    unconverged: int
    undetermined: list[str]
    repeat: RepeatField | None
    chart_power_on_sd: float | None
    chart_dof: int | None
    units: list[UnitChannelField]


class LimitField(TypedDict):
    """A unit beyond a limit of Table 1, or so near that it is not told.

    `serial_number` is empty for a log that states none. `value` is the worst power-on's bias, or the noise over all
    logs; `above` of `of` power-ons (of a bias) are beyond the limit by three sd.
    """

    serial_number: str
    channel: str
    quantity: Quantity
    verdict: LimitVerdict
    value: float
    sd: float
    limit: float
    unit: str
    above: int
    of: int
    log: str
    start_utc: str | None
    converged: bool


class ParameterField(PartsField):
    """A parameter of an effect over the fleet; `values` are those with an sd."""

    name: str
    unit: str
    values: int
    units: list["UnitParameterField"]


class UnitParameterField(TypedDict):
    """A unit's own value of a parameter, and the same less the model's."""

    serial_number: str
    value: EstimateField | None
    own: EstimateField | None


class EffectField(TypedDict):
    """An effect on channels: where it was found, of those units and power-ons that were traced, and what it amounts to.

    `level` is where it belongs: to the model (half of the units or more), to some units, to a unit, to a day.
    """

    effect: str
    label: str
    channels: list[str]
    units: list[str]
    units_traced: int
    power_ons: int
    power_ons_traced: int
    logs: int
    confirmed: int
    unconfirmed: int
    unjudged: int
    level: Level
    params: list[ParameterField]


class UnitField(TypedDict):
    """A unit of the group."""

    serial_number: str
    logs: int
    power_ons: int
    first_utc: str | None
    last_utc: str | None


class GroupField(TypedDict):
    """Units of one model whose readings are of one kind; `unknown_unit` are logs that state no serial number."""

    kind: Kind
    instrument: str
    logs: int
    units: list[UnitField]
    unknown_unit: list[str]
    channels: list[ChannelField]
    limits: list[LimitField]
    effects: list[EffectField]
    traced_logs: int
    notes: list[str]


class ErrorField(TypedDict):
    """A log without a result, and why."""

    log: str
    error: str


class SummaryDocument(TypedDict):
    """A fleet's summary; `results` is the file whose rows it is of."""

    version: int
    library: str
    results: str
    rows: int
    used: int
    errors: list[ErrorField]
    trace_errors: list[ErrorField]
    groups: list[GroupField]
