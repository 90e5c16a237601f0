"""A fleet's summary in sentences: which units fail, which drift, which days stand out, which effects recur.

Terminal and page have the same sentences; the page has more of them.
"""

from collections.abc import Iterator, Sequence

from filters import specification
from filters.channels import DPS, MG
from imutui.jobs.campaign.summary_document import (
    ChannelField,
    ComponentField,
    EffectField,
    EstimateField,
    GroupField,
    LimitField,
    SummaryDocument,
    UnitChannelField,
)
from imutui.jobs.quantities import plural
from imutui.report.numbers import NOTHING, plus_minus, three_digits

LEVELS = {
    "model": "the model's: in half of the units or more",
    "some_units": "of some units",
    "unit": "this unit's own",
    "day": "of single days",
    "not_told": "not told: nothing to compare with",
}


def extent(group: GroupField) -> str:
    """Units, power-ons, logs, and from when to when."""
    units = group["units"]
    power_ons = sum(unit["power_ons"] for unit in units)
    counts = f"{plural(len(units), 'unit')}, {plural(power_ons, 'power-on')}, {plural(group['logs'], 'log')}"
    times = sorted(t for unit in units for t in (unit["first_utc"], unit["last_utc"]) if t)
    return counts + (f", {from_to(times[0], times[-1])}" if times else "")


def from_to(first: str, last: str) -> str:
    """Dates of two times, or the one they share."""
    begin, end = day(first), day(last)
    return begin if begin == end else f"{begin} to {end}"


def day(utc: str | None) -> str:
    """Date of a time."""
    return (utc or "")[:10] or "time not stated"


def left_out(document: SummaryDocument) -> str:
    """How many logs have no result."""
    bad = len(document["errors"])
    if not bad:
        return f"All {plural(document['rows'], 'log')} have a result."
    verbs = "has no result and is left out" if bad == 1 else "have no result and are left out"
    return f"{bad} of {plural(document['rows'], 'log')} {verbs}; the reason is listed."


def limits(group: GroupField) -> list[str]:
    """Return which units fail the data sheet of their kind."""
    if not specification.is_known(group["instrument"]):
        return ["No unit is judged by limits: no data sheet of this kind of unit is known."]
    failed = [one for one in group["limits"] if one["verdict"] == "fails"]
    vague = [one for one in group["limits"] if one["quantity"] == "noise" and one["verdict"] == "not_told"]
    unsettled = [
        one for one in group["limits"]
        if one["quantity"] != "noise" and one["verdict"] != "fails" and not one["converged"]
    ]  # fmt: skip
    told = [_limit(one) for one in group["limits"] if one not in vague and one not in unsettled]
    told += [_unsettled([one for one in unsettled if _who(one) == who]) for who in dict.fromkeys(map(_who, unsettled))]
    told += [_vague([one for one in vague if _who(one) == who]) for who in dict.fromkeys(map(_who, vague))]
    if failed:
        return told
    return [f"No unit fails a limit of {limits_of(group['instrument'])}.", *told]


def limits_of(instrument: str) -> str:
    """Where limits are from, and what they are."""
    spec = specification.of_model(instrument)
    bias = f"bias {spec.gyro_bias_limit / DPS:g} deg/s and {spec.accel_bias_limit / MG:g} mg"
    noise = f"noise {spec.gyro_arw / DPS * 60.0:g} deg/√h and {spec.accel_vrw * 60.0:g} m/s/√h"
    return f"{spec.source} ({bias}, {noise})"


def _unsettled(biases: Sequence[LimitField]) -> str:
    named = ", ".join(f"{one['channel']} {plus_minus(one['value'], one['sd'], one['unit'])}" for one in biases)
    what, verb = ("biases", "have") if len(biases) > 1 else ("bias", "has")
    logs = ", ".join(dict.fromkeys(f"{day(one['start_utc'])}, {one['log']}" for one in biases))
    return f"{_who(biases[0])}: {what} of {named} {verb} not settled, so that nothing is judged ({logs})."


def _vague(noises: Sequence[LimitField]) -> str:
    channels = ", ".join(one["channel"] for one in noises)
    return f"{_who(noises[0])}: noise of {channels} is too near the limit to tell; longer or more logs would do it."


def _who(one: LimitField) -> str:
    return f"Unit {one['serial_number']}" if one["serial_number"] else f"Log {one['log']} (unit not stated)"


def _limit(one: LimitField) -> str:
    who = _who(one)
    value = plus_minus(one["value"], one["sd"], one["unit"])
    limit = f"limit {one['limit']:g} {one['unit']}"
    if one["quantity"] == "noise":
        return f"{who} FAILS: noise of {one['channel']} {value} over its logs, {limit}."
    where = f"{day(one['start_utc'])}, {one['log']}"
    if one["verdict"] == "fails":
        days = f"in {one['above']} of {plural(one['of'], 'power-on')}"
        return f"{who} FAILS: bias of {one['channel']} {value}, {limit}, {days}; worst {where}."
    return f"{who}: bias of {one['channel']} {value}, {limit}, is too near the limit to tell ({where})."


def drifts(group: GroupField) -> list[str]:
    """Which units drift, which follow temperature, and where it can't be told."""
    each = [(one, unit) for one in group["channels"] for unit in one["units"]]
    told = [s for one, unit in each if (s := _drift(one, unit))]
    tests = sum(unit["drift"]["verdict"] not in ("too_few", "no_times") for _, unit in each)
    drifting = any(unit["drift"]["verdict"] == "drift" for _, unit in each)
    tested = f"tested at 5 % over {plural(tests, 'pair')} of unit and channel together (Holm's correction)"
    if tests and not drifting:
        told.insert(0, f"No unit drifts: {tested}.")
    elif tests:
        told.append(f"{tested[:1].upper()}{tested[1:]}.")
    for verdict, why in (
        ("too_few", "fewer than three power-ons at different times, or nothing tells how days scatter"),
        ("no_times", "logs that do not say when they were recorded"),
    ):
        units = sorted({unit["serial_number"] for _, unit in each if unit["drift"]["verdict"] == verdict})
        told += [f"{_units(units)}: {why}; no drift can be told."] if units else []
    return told


def _units(units: Sequence[str]) -> str:
    named = ", ".join(units[:8]) + (f" and {len(units) - 8} more" if len(units) > 8 else "")
    return ("Unit " if len(units) == 1 else "Units ") + named


def _drift(one: ChannelField, unit: UnitChannelField) -> str:
    drift, which = unit["drift"], f"Unit {unit['serial_number']}"
    month, kelvin, channel = drift["per_month"], drift["per_kelvin"], one["channel"]
    if drift["verdict"] == "drift" and month:
        beside = "temperature is not known or hardly varied"
        if kelvin:
            beside = f"beside {_of(kelvin, one['unit'] + '/K')} of temperature"
        p = f"p {drift['p_holm']:.1g}" if drift["p_holm"] else ""
        return f"{which} DRIFTS: {channel} {_of(month, one['unit'] + ' a month')} ({beside}; {p})."
    if drift["verdict"] == "temperature":
        size = f" by {_of(kelvin, one['unit'] + '/K')}" if kelvin else ""
        return f"{which} follows temperature: {channel}{size}; time explains nothing beside it, so this is no drift."
    if drift["verdict"] == "drift_or_temperature":
        alone = drift["per_month_alone"]
        size = f" by {_of(alone, one['unit'] + ' a month')} if it were time alone" if alone else ""
        return (
            f"{which}: {channel} changes{size}, but temperature changed together with time: drift and temperature are"
            " not told apart. Power-ons at other temperatures would do it."
        )
    return ""


def _of(found: EstimateField, unit: str) -> str:
    return plus_minus(found["value"], found["sd"], unit)


def days_out(group: GroupField) -> list[str]:
    """Power-ons that fall out of their control chart."""
    return [
        f"Unit {unit['serial_number']}, {one['channel']}, {day(point['start_utc'])}: {three_digits(point['value'])}"
        f" {one['unit']} is outside {three_digits(point['low'])} to {three_digits(point['high'])} ({point['log']}"
        + ("" if point["converged"] else "; it has not settled")
        + ")."
        for one in group["channels"]
        for unit in one["units"]
        for point in unit["points"]
        if point["outside"] and point["low"] is not None and point["high"] is not None
    ]


def charts(group: GroupField) -> str:
    """What charts rest on, or why there is none."""
    if any(one["chart_dof"] for one in group["channels"]):
        return (
            "A power-on stands out if its bias is further than 3 σ from the others of its unit, σ being how power-ons"
            " of this model scatter; the limits are wider where few power-ons tell σ."
        )
    return "Too few power-ons for a control chart: three more than there are units are the least."


def in_control(group: GroupField) -> list[str]:
    """Channels whose scatter between days holds days that stand out, and what it is without."""
    return [
        f"{one['channel']}: days that stand out are counted in; without them days scatter by"
        f" {one['chart_power_on_sd']:.2g} {one['unit']}."
        for one in group["channels"]
        if one["chart_power_on_sd"] is not None and any(p["outside"] for unit in one["units"] for p in unit["points"])
    ]


def undetermined(group: GroupField) -> list[str]:
    """What these units and power-ons do not tell apart, a sentence each."""
    return list(dict.fromkeys(sentence for one in group["channels"] for sentence in one["undetermined"]))


def repeats(group: GroupField) -> Iterator[str]:
    """Channels whose logs of one power-on disagree."""
    for one in group["channels"]:
        repeat = one["repeat"]
        if repeat and repeat["scale"] > 1.0:
            yield (
                f"{one['channel']}: logs of one power-on differ by more than their standard deviations say; all of them"
                f" are taken {repeat['scale']:.2g} times as large."
            )


def omissions(group: GroupField) -> Iterator[str]:
    """Which biases are in no estimate, and which had not settled."""
    for key, what in (
        ("unobservable", "their reference does not show this bias"),
        ("unmeasured", "the filter knows it hardly better than at its start"),
    ):
        counts = [(one["channel"], one[key]) for one in group["channels"] if one[key]]  # type: ignore[literal-required]
        if counts:
            yield f"Left out, since {what}: {_counts(counts)}."
    counts = [(one["channel"], one["unconverged"]) for one in group["channels"] if one["unconverged"]]
    if counts:
        yield f"Used, though the estimate had not settled: {_counts(counts)}."


def _counts(counts: Sequence[tuple[str, int]]) -> str:
    return ", ".join(f"{channel} of {plural(n, 'log')}" for channel, n in counts)


def value(found: EstimateField | None) -> str:
    """A value with its sd; a dash where it is not determined."""
    return NOTHING if found is None else plus_minus(found["value"], found["sd"], "")


def component(found: ComponentField | None) -> str:
    """A standard deviation with its interval, below each other where a cell has room."""
    if found is None:
        return NOTHING
    sd, low, high = map(_two_digits, (found["sd"], found["low"], found["high"]))
    return f"{sd}\n({low} to {high})"


def _two_digits(sd: float) -> str:
    return "0" if sd == 0.0 else f"{sd:.0f}" if sd >= 99.5 else f"{sd:#.2g}".removesuffix(".")


def effect_where(one: EffectField) -> str:
    """In how many units and power-ons an effect was found, and in how many logs it was confirmed."""
    units = (
        f"{len(one['units'])} of {one['units_traced']} units, {one['power_ons']} of {one['power_ons_traced']} power-ons"
    )
    judged = one["confirmed"] + one["unconfirmed"]
    return units + (
        f"; confirmed in {one['confirmed']} of {judged} that were judged" if judged else "; none was judged"
    )
