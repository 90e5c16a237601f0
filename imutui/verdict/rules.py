"""The verdict on a filter: one word, its reason, and what to do. Screen and commands call the same function.

GREEN: every bias that can be seen has converged, and nothing is unexplained. AMBER: wait, or look. RED: do something.
OFF: there is no filter. WAIT: it has not begun. Each rule is one `Check` with its threshold in its text, so that the
page can show which rule made the word. A running filter and the result of a run that is over are judged alike.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeAlias

from filters.effects import plain_names
from filters.health.finding import ADVICE, HealthEntry, without_bias
from imutui.estimates import (
    Bias,
    CauseField,
    FilterSnapshot,
    NisFields,
    NoiseFields,
    RemainderField,
    biases,
    live_biases,
    specification_of,
)

if TYPE_CHECKING:
    from imutui.logbook.results import ResultDocument

Judged: TypeAlias = "FilterSnapshot | ResultDocument"

GYRO_TOLERANCE_DPS = 0.05
ACCEL_TOLERANCE_MG = 0.6
NOTICED, TOO_MUCH = 2.0, 3.0  # means of 10 s over what noise allows: beyond these, AMBER and RED
FEWEST_WINDOWS = 3  # means of 10 s before their size says anything: one alone exceeds 2 in one case of twenty
TOO_NOISY, CERTAIN_SD, KNOWN_SD = 1.3, 5.0, 0.2
"""White noise over what the filter takes for it, and standard deviations of that ratio above 1: beyond both, AMBER,
once it is known so well."""
STEADY_K_PER_MIN = 0.1
MOVES_SD = 0.5  # change over 10 s, in standard deviations, that is worth a word
SITE_NOT_STATED = (
    "the site is not stated: gravity is that of the default place, so the ± of the accelerometer along the vertical"
    " includes 2.6 mg (1 sd) for gravity elsewhere. State it: --site LAT,LON,H where you record or import,"
    " --set site.gravity_mps2=M_S2 where you replay"
)
BIAS_DECIMALS = {"deg/s": 4, "mg": 2}
_NOTHING = "–"
_AT_REST = ("level", "gravity")
USE = "usable; unseen: effects of motion, slow ones: t"
"""What GREEN allows and has not looked for, as short as a badge."""
USE_AT_LENGTH = (
    "the biases can be used: corrected reading = reading − bias. Looked at: channels, alarms, limits, convergence,"
    " 10 s means, noise, oscillations, steps, temperature; not: effects of motion and slow ones, which a trace finds"
)
TRACE_KEY = "t traces this recording"  # what to do on the screen; a command says the same in its words

ENDED = "ENDED"
WORDS = {"good": "GREEN", "wait": "AMBER", "bad": "RED"}
SIGNS = {"GREEN": "●", "AMBER": "▲", "RED": "×", "WAIT": "…", "OFF": "–", ENDED: "–"}
"""Beside the word: state is said twice, and never by colour alone."""
LEVEL_MARKS = {"good": "ok", "wait": "wait", "bad": "BAD", "none": "-"}  # a check's level as a word
CHANNELS_CHECK = "channels"  # name of the checks on channel health
RANK = {"none": 0, "good": 1, "wait": 2, "bad": 3}  # of a level: the worst one decides


@dataclass(frozen=True, slots=True)
class Check:
    """One rule, applied."""

    level: str  # "good", "wait" or "bad"; "none" where it says nothing
    name: str  # of the rule
    said: str  # what was found, with its threshold
    brief: str = ""  # the same in a few characters
    todo: str = ""  # what to do about it; empty for nothing


@dataclass(frozen=True, slots=True)
class Verdict:
    """The badge."""

    level: str  # "good", "wait", "bad" or "none"; it only colours
    word: str  # GREEN, AMBER, RED, WAIT, OFF or ENDED
    # reason, todo: why, and what to do
    reason: str
    todo: str = ""
    brief: str = ""  # the reason in a few characters, for the header
    checks: tuple[Check, ...] = ()  # all rules
    # whether it is shown at once, however short the last word stood
    sudden: bool = False

    @property
    def passes(self) -> bool:
        """True if a command that ends with it exits with 0: GREEN, or no filter ran and no channel is at fault."""
        return self.level not in ("wait", "bad")

    @property
    def fault(self) -> str:
        """Return the worst fault of a channel in a few characters, such as `gy dead`; empty if there is none."""
        return next(
            (check.brief for check in self.checks if check.name == CHANNELS_CHECK and check.level != "good"), ""
        )

    @property
    def badge(self) -> str:
        """Sign and word of the verdict, such as `● GREEN`."""
        return f"{SIGNS[self.word]} {self.word}"

    @property
    def todo_at_length(self) -> str:
        """Return what to do, at length; limits that were not judged are not listed as checked."""
        unjudged = any(check.name == "limit" and check.level == "none" for check in self.checks)
        at_length = USE_AT_LENGTH.replace(" limits,", "") if unjudged else USE_AT_LENGTH
        return at_length if self.todo == USE else self.todo

    def followed_by(self, todo: str) -> str:
        """Return the reason and what to do as sentences; a key that begins the second one stays as it is typed."""
        reason = self.reason if self.reason.endswith("?") else f"{self.reason}."
        is_key = todo[1:2] == " "
        return f"{reason} {todo if is_key else todo[:1].upper() + todo[1:]}." if todo else reason

    @property
    def short(self) -> str:
        """Sign, word and reason for a header."""
        return f"{'channels' if self.fault else 'filter'} {self.badge} {self.brief}".rstrip()


def judge(
    of: "Judged | None",
    health: Sequence[HealthEntry] = (),
    *,
    silent: str | None = None,
    waiting_profile: str | None = None,
) -> Verdict:
    """Return the verdict on a unit's channels and on its filter.

    `of`: None for an acquisition or a log without a filter.
    `health`: faults of the channels.
    `silent`: that the line is silent, in words, if it is.
    `waiting_profile`: that a table profile waits to be begun, in words, if one does.
    """
    channels, waiting = _health(health), _waiting(of)
    if any(check.level == "bad" for check in channels) or (of is None and health):
        # the estimates from such readings mean nothing: the verdict does not wait for them
        rules = () if of is None or waiting else tuple(_rules(of, health, waiting_profile))
        return replace(_of((*channels, *(check for check in rules if check))), sudden=True)
    if of is None:
        reason = "no filter in this acquisition: readings are taken, nothing is estimated"
        aside = "5 Table lays the profile aside, or traces its recording"
        todo = "1 Connect starts one with a filter" if waiting_profile is None else aside
        return Verdict("none", "OFF", reason, todo, sudden=True)
    running = _running(of, silent)
    checks = tuple(check for check in (running, *channels, *_rules(of, health, waiting_profile)) if check)
    if running.level == "bad":
        return replace(_of(checks), sudden=True)
    if waiting:
        # once samples come, what the operator can do about it comes before what the filter waits for
        reason = waiting_profile if waiting_profile and of["samples"] else waiting
        return Verdict("none", "WAIT", reason, checks=checks[:1], sudden=True)
    found, held = _of(checks), held_text(of["held_since_s"])
    return found if held is None else replace(found, reason=f"{found.reason}; {held}")


def bias_levels(of: FilterSnapshot, health: Sequence[HealthEntry]) -> list[str]:
    """Return the level of each bias by the rules on one: health, limit, convergence, effects, what is unexplained.

    A bias that cannot be seen is as one that there is no filter for, unless something on its channel is unexplained.
    """
    return [_level(of, bias, [one for one in health if one["channel"] == bias.channel]) for bias in live_biases(of)]


def _level(of: FilterSnapshot, bias: Bias, health: Sequence[HealthEntry]) -> str:
    name, departure = bias.channel, of["departure"]
    checks = [_running(of, None), *_health(health)]
    if not _waiting(of):
        checks += [
            _limits([bias], specification_of(of).source),
            _converged(of, [bias], health, None),
            _causes([one for one in of["causes"] if one["channel"] == name]),
            _unexplained(
                [one for one in of["remainder"] if one["channel"] == name],
                departure if departure is not None and f" {name} reads " in departure else None,
                over=False,
            ),
        ]
    worst = max((check.level for check in checks), key=RANK.__getitem__)
    hidden = _waiting(of) or not bias.observable
    return "none" if hidden and worst != "bad" else worst


def _waiting(of: "Judged | None") -> str:
    """Return what a filter waits for before it can be judged, in words; empty if it can."""
    if of is None or "waiting" not in of:
        return ""
    return of["waiting"] or ("" if of["samples"] else "waiting for the first sample")


def held_text(since: float | None) -> str | None:
    """Return in words that the reference has ended, and when in the run; None while there is one."""
    if since is None:
        return None
    whole = int(since)
    return f"no reference any more since {whole // 3600}:{whole // 60 % 60:02d}:{whole % 60:02d}, biases held"


def _of(checks: tuple[Check, ...]) -> Verdict:
    worst = max(checks, key=lambda check: RANK[check.level])  # the first of the worst: rules stand in order of weight
    if worst.level not in ("wait", "bad"):
        return _green(checks)
    others = [check for check in checks if check.level == worst.level and check is not worst]
    also = f"; also {', '.join(check.brief for check in others)}" if others else ""
    # the temperature comes last: the rest is well by then, and the reason says so
    well = f"{_named(checks, 'converged').said}, but " if worst.name == "temperature" else ""
    return Verdict(worst.level, WORDS[worst.level], well + worst.said + also, worst.todo, worst.brief, checks)


def _named(checks: Sequence[Check], name: str) -> Check:
    return next(check for check in checks if check.name == name)


def _green(checks: tuple[Check, ...]) -> Verdict:
    converged, rest = _named(checks, "converged"), _named(checks, "unexplained")
    nothing = "means over 10 s are as noise allows" if rest.level == "good" else f"the unexplained part is {rest.said}"
    done, *hidden = converged.said.split("; ")
    wide = [check.said for check in checks if check.name == "site"]
    return Verdict("good", WORDS["good"], "; ".join([done, nothing, *hidden, *wide]), USE, converged.brief, checks)


def _rules(of: Judged, health: Sequence[HealthEntry], waiting_profile: str | None) -> list[Check | None]:
    is_over = "waiting" not in of
    every = live_biases(of) if "waiting" in of else biases(of)
    return [
        _alarms(of),
        _limits(every, specification_of(of).source),
        _nis(of["nis"]),
        _converged(of, every, health, waiting_profile),
        _causes(of["causes"]),
        _unexplained(of["remainder"], of["departure"], over=is_over),
        _noise(of["noise"], of["reference"]),
        _temperature(of["temperature_k_per_min"], over=is_over),
        _confounded(of["confounded"]),
        _site(every),
    ]


def _running(of: Judged, silent: str | None) -> Check:
    if failure := _failure(of):
        return Check("bad", "running", failure, "stopped", "check mounting and rate; r starts anew")
    if silent is not None:
        return Check("wait", "running", "no new data: the estimates are old", "no data", "check power and cable")
    return Check("good", "running", "data come")


def _failure(of: Judged) -> str | None:
    return of["failure"] if "waiting" in of else None


def _health(health: Sequence[HealthEntry]) -> list[Check]:
    """Return a check for each kind of fault that channels have, the worst first."""
    kinds: dict[str, list[HealthEntry]] = {}
    for entry in health:
        kinds.setdefault(entry["kind"], []).append(entry)
    if not kinds:
        return [Check("good", CHANNELS_CHECK, "no fault shows")]
    return [_of_kind(found) for found in kinds.values()]


def _of_kind(found: Sequence[HealthEntry]) -> Check:
    first, others = found[0], found[1:]
    also = (
        f" (so {'is' if len(others) == 1 else 'are'} {', '.join(one['channel'] for one in others)})" if others else ""
    )
    brief = f"{' '.join(one['channel'] for one in found[:3])} {first['kind']}"
    return Check(first["level"], CHANNELS_CHECK, first["said"] + also, brief, ADVICE[first["kind"]])


def _alarms(of: Judged) -> Check:
    alarms = [alarm for alarm in of["alarms"] if alarm != _failure(of)]
    if not alarms:
        return Check("good", "alarms", "none")
    count = "alarm" if len(alarms) == 1 else f"{len(alarms)} alarms"
    # a departure in a profile names the place; the alarms are listed beside it
    said = alarms[0] if of["departure"] is None else of["departure"]
    return Check("bad", "alarms", f"{count}: {said}", count, "put that right first")


def _limits(every: Sequence[Bias], source: str) -> Check:
    if all(bias.limit is None for bias in every):
        return Check("none", "limit", "not judged: the data sheet of this unit is not known")
    known = [
        (abs(bias.value), bias.limit, bias)
        for bias in every
        if bias.observable and bias.value is not None and bias.limit is not None
    ]
    if not known:
        return Check("none", "limit", "no estimate yet")
    size, limit, worst = max(known, key=lambda one: one[0] / one[1])
    unit = worst.unit
    said = f"{worst.name} bias {_number(worst.value, unit)} ±{_number(worst.sd3, unit)} {unit} (3 sd)"
    allowed = f"{source}'s ±{limit:g} {unit}"
    if size <= limit:
        return Check("good", "limit", f"{worst.name} at {100.0 * size / limit:.0f} % of {source}'s, the most")
    brief = f"{worst.channel} limit"
    if size - (worst.sd3 or 0.0) <= limit:
        return Check("wait", "limit", f"{said} may be outside {allowed}", brief, "wait until its 3 sd are smaller")
    todo = "check level, mounting, sign; else the sensor is out of spec"
    return Check("bad", "limit", f"{said} is outside {allowed}", brief, todo)


def _number(value: float | None, unit: str) -> str:
    return _NOTHING if value is None or not math.isfinite(value) else f"{value:z.{BIAS_DECIMALS[unit]}f}"


def _nis(nis: NisFields) -> Check:
    meaning, mean, band = nis_meaning(nis), nis["mean"], _band(nis)
    if not nis["is_test"] or mean is None or band is None:
        return Check("none", "NIS", meaning)
    low, high = band
    if low <= mean <= high:
        return Check("good", "NIS", meaning)
    # one good filter in twenty is outside a 95 % band; hardly one in ten thousand is as far again
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    level = "bad" if abs(mean - middle) > 2.0 * half else "wait"
    todo = TRACE_KEY if mean > high else "set the filter's noise from this unit's own"
    return Check(level, "NIS", f"NIS {mean:.3g} is {meaning}", f"NIS {mean:.3g}", todo)


def _band(nis: NisFields) -> tuple[float, float] | None:
    low, high = nis["band95"] or (None, None)
    return None if low is None or high is None else (low, high)


def nis_meaning(nis: NisFields, *, whole: bool = False) -> str:
    """Return what the normalised innovation squared means; `whole` gives the reason in full."""
    if not nis["is_test"]:
        short = nis["why"].partition(",")[0].partition(":")[0].removeprefix("the ")
        short = short.replace("reference is fed exact", "exact reference")
        return f"no test: {nis['why'] if whole else short}"
    mean, limits = nis["mean"], _band(nis)
    if mean is None or limits is None:
        return "no samples yet"
    low, high = limits
    band = f"its 95 % band {low:.3g} to {high:.3g}"
    if mean > high:
        return f"above {band}: the model lacks something"
    if mean < low:
        return f"below {band}: the filter's noise is set too high"
    return f"inside {band}"


def tolerance(unit: str) -> float:
    """Return the standard deviation below which a bias counts as converged, in the unit."""
    return GYRO_TOLERANCE_DPS if unit == "deg/s" else ACCEL_TOLERANCE_MG


def filter_sd(bias: Bias) -> float | None:
    """Return the standard deviation as the filter has it, by which convergence is judged: without the site's."""
    return bias.sd if bias.sd is None else math.sqrt(max(bias.sd**2 - bias.site_sd**2, 0.0))


def moved_sd(bias: Bias) -> float | None:
    """Return the change over 10 s in standard deviations of the filter; None while one of them is not known."""
    sd = filter_sd(bias)
    return None if bias.change_10s is None or not sd else bias.change_10s / sd


def _converged(of: Judged, every: Sequence[Bias], health: Sequence[HealthEntry], waiting_profile: str | None) -> Check:
    seen = [bias for bias in every if bias.observable]
    pending = [bias for bias in seen if bias.converged_s is None]
    hidden = [_hidden(bias, health) for bias in every if not bias.observable]
    if not seen and waiting_profile is not None:
        return Check("wait", "converged", waiting_profile, "profile waits", "no bias is observable before that")
    if not seen:
        todo = "use a reference or a table profile that shows them"
        return Check("wait", "converged", "no bias is observable in this setup", "none observable", todo)
    done, count = len(seen) - len(pending), len(seen)
    brief = f"{done} of {count}"
    if not pending:
        rest = f"; not observable here: {', '.join(hidden)}" if hidden else ""
        said = f"{brief} observable biases converged{rest}" if hidden else f"all {count} biases converged"
        return Check("good", "converged", said, brief)
    waited, todo = _waited(pending, of["temperature_k_per_min"])
    todo = todo if "waiting" in of else "record longer, with the unit undisturbed"
    todo = todo if of["held_since_s"] is None else "record again, with a longer reference"
    kind = "observable biases" if hidden else "biases"
    return Check("wait", "converged", f"{brief} {kind} converged; {waited}", brief, todo)


def _hidden(bias: Bias, health: Sequence[HealthEntry]) -> str:
    fault = without_bias(health, bias.channel)
    return bias.name if fault is None else f"{bias.name} ({fault})"


def _waited(pending: Sequence[Bias], slope: float | None) -> tuple[str, str]:
    """Return what the slowest bias lacks, and what helps."""
    worst = max(pending, key=_lack)
    name, unit, need, moved, sd = worst.name, worst.unit, tolerance(worst.unit), moved_sd(worst), filter_sd(worst)
    if sd is None:
        return f"{name}: no estimate yet", ""
    if sd > need:
        return (
            f"{name}: 3 sd {3.0 * sd:.{BIAS_DECIMALS[unit]}f} {unit}, needs {3.0 * need:g}",
            "keep to the reference and wait",
        )
    if moved is not None and abs(moved) >= MOVES_SD:
        warming = slope is not None and abs(slope) > STEADY_K_PER_MIN
        said = f"{name} moves {abs(moved):.1f} sd in 10 s"
        return (
            (f"{said}: temperature {slope:+.1f} K/min", "wait until it is steady")
            if warming
            else (said, "wait until it has settled")
        )
    return f"{name} has to agree with its readings for 10 s", "keep the unit undisturbed"


def _lack(bias: Bias) -> tuple[float, float]:
    sd = filter_sd(bias)
    return max(math.inf if sd is None else sd / tolerance(bias.unit), 1.0), abs(moved_sd(bias) or 0.0)


def worst_remainder(remainder: Sequence[RemainderField]) -> tuple[str, float] | None:
    """Return the channel whose 10 s means exceed noise the most, and how many times; None while there are too few."""
    known = [(r["channel"], r["ratio"]) for r in remainder if r["ratio"] is not None and r["windows"] >= FEWEST_WINDOWS]
    return max(known, key=lambda one: one[1], default=None)


def _unexplained(remainder: Sequence[RemainderField], departure: str | None, *, over: bool) -> Check:
    worst = worst_remainder(remainder)
    if departure is not None:
        return Check("bad", "unexplained", departure, " ".join(departure.split()[:3]), TRACE_KEY)
    if worst is None:
        said = "not known: too few means of 10 s" if over else "known after 30 s"
        return Check("none", "unexplained", said)
    name, ratio = worst
    level = "bad" if ratio > TOO_MUCH else "wait" if ratio > NOTICED else "good"
    said = f"{name} 10 s means {ratio:.1f} × what noise allows"
    limit = f" (limit {NOTICED:g})" if level == "good" else f" (AMBER above {NOTICED:g}, RED above {TOO_MUCH:g})"
    return Check(level, "unexplained", said + limit, f"{name} {ratio:.1f} ×", TRACE_KEY)


def _causes(causes: Sequence[CauseField]) -> Check:
    """Check whether an effect that shows is larger than a bias may be uncertain by."""
    showing = [one for one in causes if one["shows"]]
    large = [one for one in showing if over_tolerance(one)]
    if not large:
        said = "none larger than a bias may be uncertain by" if showing else "none shows"
        return Check("good", "effects", said)
    brief = f"{large[0]['channel']} {plain_names.short(large[0]['effect'])}"
    return Check("wait", "effects", large[0]["text"], brief, TRACE_KEY)


def over_tolerance(one: CauseField) -> bool:
    """Return whether an effect takes readings farther from their mean than a converged bias may be uncertain by."""
    if one["effect"] == "noise_level":
        return not 1.0 / TOO_NOISY < one["size"] < TOO_NOISY
    return one["extent"] > (GYRO_TOLERANCE_DPS if one["unit"].startswith("deg") else ACCEL_TOLERANCE_MG)


def _noise(noise: NoiseFields, reference: str) -> Check | None:
    """Judge whether the white noise is what the filter takes for it: else its standard deviations are too small.

    Of gyros and accelerometers the noisier ones count, and of these the quietest channel: what moves one channel alone
    is an effect, and no noise of the unit. Nothing is known of a unit that moves.
    """
    sd, used = noise["relative_sd"], noise["used"]
    if reference not in _AT_REST or sd is None:
        return None
    kinds = {
        "gyros": (noise["gyro_arw_deg_sqrt_h"], used["gyro_arw_deg_sqrt_h"]),
        "accelerometers": (noise["accel_vrw_mps_sqrt_h"], used["accel_vrw_mps_sqrt_h"]),
    }
    ratios = {
        kind: [of / expected for of, expected in zip(measured, taken, strict=True) if of is not None and expected]
        for kind, (measured, taken) in kinds.items()
    }
    ratio, name = max(((min(known), kind) for kind, known in ratios.items() if known), default=(None, ""))
    if ratio is None:
        return None
    if sd > KNOWN_SD or ratio < max(TOO_NOISY, 1.0 + CERTAIN_SD * sd):
        return Check("good", "noise", f"{name} {ratio:.2f} × what the filter expects, at least")
    said = f"{name} are {ratio:.1f} × as noisy as the filter expects, so their ± are too small by as much"
    todo = "record at the unit's full rate, or replay with --set filter.noise=log"
    return Check("wait", "noise", said, f"{name} noise", todo)


def _temperature(slope: float | None, *, over: bool) -> Check:
    if slope is None and over:
        return Check("none", "temperature", "its trend is not known")
    if slope is None:
        return Check(
            "wait",
            "temperature",
            "the temperature's trend is known after 30 s only",
            "T not known",
            "keep still and wait",
        )
    steady = abs(slope) <= STEADY_K_PER_MIN
    if steady:
        return Check("good", "temperature", f"steady within ±{STEADY_K_PER_MIN:g} K/min")
    todo = f"wait until it is within ±{STEADY_K_PER_MIN:g} K/min"
    return Check("wait", "temperature", f"temperature moves them, by {slope:+.1f} K/min", "T moves", todo)


def _confounded(sentences: Sequence[str]) -> Check | None:
    if not sentences:
        return None
    return Check("wait", "motion", sentences[0], "motion", "")


def _site(every: Sequence[Bias]) -> Check | None:
    """Return which ± are wide because the site is not stated; it decides nothing, since the filter is as good."""
    wide = [bias.name for bias in every if bias.observable and bias.site_sd > ACCEL_TOLERANCE_MG]
    if not wide:
        return None
    said = f"the ± of {' and '.join(wide)} is wide, as the site is not stated: --site LAT,LON,H"
    return Check("none", "site", said)
