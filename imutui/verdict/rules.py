"""May the filter be believed: one word, its reason, and what to do; the one function that the screen and commands ask.

GREEN: every bias that can be seen has converged, and nothing is unexplained. AMBER: wait, or look. RED: do something.
OFF: there is no filter. WAIT: it has not begun. Each rule is one `Check` with its threshold in its text, so that the
page can show which rule made the word. What is judged is a `Standing`, which `sources` makes of a snapshot or a result.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from filters.effects import plain_names
from filters.health.finding import ADVICE, HealthEntry, without_bias
from imutui.filter_snapshot import BiasSnapshot, CauseSnapshot, NisSnapshot, NoiseSnapshot, RemainderSnapshot

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
RANK = {"none": 0, "good": 1, "wait": 2, "bad": 3}  # of a level: the worst is told


@dataclass(frozen=True, slots=True)
class Standing:
    """What a filter has come to, of a run that goes on or is over."""

    t: float | None  # of its last sample, s; None before the first
    biases: Sequence[BiasSnapshot]  # six, in the instrument's axes
    nis: NisSnapshot  # mean, band, and whether it is a test
    remainder: Sequence[RemainderSnapshot]  # what the model leaves unexplained, by channel
    # alarms, confounded: sentences on data that contradict the model, and on biases that the motion does not tell from
    # other effects
    alarms: Sequence[str]
    confounded: Sequence[str]
    # what is noisier than the filter expects; None while that is not known, or the unit moves
    noise: NoiseSnapshot | None = None
    slope_k_per_min: float | None = None  # of the temperature; None while it is not known
    # where in a table profile the readings depart from the model, and what it may be, in words
    departure: str | None = None
    causes: Sequence[CauseSnapshot] = ()  # effects that the residual shows or showed
    # when the reference ended, s, from where on biases are held; None while there is one
    held_since: float | None = None
    failure: str | None = None  # why the filter stopped, if it did
    waiting: str | None = None  # what it waits for, in words
    silent: str | None = None  # that the line is silent, in words, if it is
    waiting_profile: str | None = None  # that a table profile waits to be begun, in words, if one does
    over: bool = False  # whether no sample comes any more
    limits_of: str = "Table 1"  # where the limits of the biases are from


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
    # whether it is shown at once, however short the last word stood: there is no filter to wait with
    sudden: bool = False

    @property
    def passes(self) -> bool:
        """Whether a command that ends with it exits with 0: GREEN, or no filter ran and no channel is at fault."""
        return self.level not in ("wait", "bad")

    @property
    def fault(self) -> str:
        """The worst fault of a channel in a few characters, such as `gy dead`; empty if there is none."""
        return next(
            (check.brief for check in self.checks if check.name == CHANNELS_CHECK and check.level != "good"), ""
        )

    @property
    def badge(self) -> str:
        """Sign and word of the verdict, such as `● GREEN`."""
        return f"{SIGNS[self.word]} {self.word}"

    @property
    def todo_at_length(self) -> str:
        """Return what to do, where there is room for all of it; what was not judged is not called looked at."""
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


def judge(standing: Standing | None, health: Sequence[HealthEntry] = ()) -> Verdict:
    """Return the verdict on a unit's channels and on its filter.

    `standing`: None for an acquisition or a log without a filter.
    `health`: faults of the channels.
    """
    channels = _health(health)
    if any(check.level == "bad" for check in channels) or (standing is None and health):
        # what a filter makes of such readings says nothing: it is not waited for
        rules = () if standing is None or standing.waiting or standing.t is None else tuple(_rules(standing, health))
        return replace(_of((*channels, *(check for check in rules if check))), sudden=True)
    if standing is None:
        reason = "no filter in this acquisition: readings are taken, nothing is estimated"
        return Verdict("none", "OFF", reason, "1 Connect starts one with a filter", sudden=True)
    checks = tuple(check for check in (_running(standing), *channels, *_rules(standing, health)) if check)
    if checks[0].level == "bad":
        return replace(_of(checks), sudden=True)
    if standing.waiting or standing.t is None:
        reason = standing.waiting or "waiting for the first sample"
        return Verdict("none", "WAIT", reason, checks=checks[:1], sudden=True)
    found = _of(checks)
    held = held_text(standing.held_since)
    return found if held is None else replace(found, reason=f"{found.reason}; {held}")


def held_text(since: float | None) -> str | None:
    """That the reference has ended, and when in the run, in words; None while there is one."""
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
    # the temperature comes last: by then the rest is well, which is worth saying
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


def _rules(standing: Standing, health: Sequence[HealthEntry]) -> list[Check | None]:
    return [
        _alarms(standing),
        _limits(standing.biases, standing.limits_of),
        _nis(standing.nis),
        _converged(standing, health),
        _causes(standing.causes),
        _unexplained(standing),
        _noise(standing.noise),
        _temperature(standing.slope_k_per_min, over=standing.over),
        _confounded(standing.confounded),
        _site(standing.biases),
    ]


def _running(standing: Standing) -> Check:
    if standing.failure:
        return Check("bad", "running", standing.failure, "stopped", "check mounting and rate; r starts anew")
    if standing.silent is not None:
        return Check("wait", "running", "no new data: the estimates are old", "no data", "check power and cable")
    return Check("good", "running", "data come")


def _health(health: Sequence[HealthEntry]) -> list[Check]:
    """One check for each kind of fault that channels have, the worst first."""
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


def _alarms(standing: Standing) -> Check:
    alarms = [alarm for alarm in standing.alarms if alarm != standing.failure]
    if not alarms:
        return Check("good", "alarms", "none")
    count = "alarm" if len(alarms) == 1 else f"{len(alarms)} alarms"
    # a profile's departure says where; the alarms themselves are told beside it
    said = alarms[0] if standing.departure is None else standing.departure
    return Check("bad", "alarms", f"{count}: {said}", count, "put that right first")


def _limits(biases: Sequence[BiasSnapshot], source: str) -> Check:
    if all(bias["limit"] is None for bias in biases):
        return Check("none", "limit", "not judged: the data sheet of this unit is not known")
    known = [
        (abs(bias["value"]), bias["limit"], bias)
        for bias in biases
        if bias["observable"] and bias["value"] is not None and bias["limit"] is not None
    ]
    if not known:
        return Check("none", "limit", "no estimate yet")
    size, limit, worst = max(known, key=lambda one: one[0] / one[1])
    sd3, unit = worst["sd3"] or 0.0, worst["unit"]
    bias = f"{worst['name']} bias {bias_text(worst)} {unit} (3 sd)"
    allowed = f"{source}'s ±{limit:g} {unit}"
    if size <= limit:
        return Check("good", "limit", f"{worst['name']} at {100.0 * size / limit:.0f} % of {source}'s, the most")
    brief = f"{channel(worst['name'])} limit"
    if size - sd3 <= limit:
        return Check("wait", "limit", f"{bias} may be outside {allowed}", brief, "wait until its 3 sd are smaller")
    todo = "check level, mounting, sign; else the sensor is out of spec"
    return Check("bad", "limit", f"{bias} is outside {allowed}", brief, todo)


def bias_text(bias: BiasSnapshot) -> str:
    """Estimate ± 3 sd, without the unit."""
    return f"{_number(bias['value'], bias['unit'])} ±{_number(bias['sd3'], bias['unit'])}"


def _number(value: float | None, unit: str) -> str:
    return _NOTHING if value is None or not math.isfinite(value) else f"{value:z.{BIAS_DECIMALS[unit]}f}"


def _nis(nis: NisSnapshot) -> Check:
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


def _band(nis: NisSnapshot) -> tuple[float, float] | None:
    low, high = nis["band95"] or (None, None)
    return None if low is None or high is None else (low, high)


def nis_meaning(nis: NisSnapshot, *, whole: bool = False) -> str:
    """What the normalised innovation squared says; `whole` with the reason in full."""
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
    """Standard deviation below which a bias counts as converged."""
    return GYRO_TOLERANCE_DPS if unit == "deg/s" else ACCEL_TOLERANCE_MG


def filter_sd3(bias: BiasSnapshot) -> float | None:
    """Return three standard deviations as the filter has them, by which convergence is judged: without the site's."""
    sd3, of_site = bias["sd3"], bias["site_sd3"]
    return sd3 if sd3 is None else math.sqrt(max(sd3**2 - of_site**2, 0.0))


def moved_sd(bias: BiasSnapshot) -> float | None:
    """Change over 10 s in standard deviations of the filter; None while one of them is not known."""
    sd3 = filter_sd3(bias)
    if bias["change_10s"] is None or not sd3:
        return None
    return float(3.0 * bias["change_10s"] / sd3)


def channel(name: str) -> str:
    """Short name: "z gyro" is gz."""
    axis, _, kind = name.partition(" ")
    return f"{kind[:1]}{axis}"


def _converged(standing: Standing, health: Sequence[HealthEntry]) -> Check:
    biases, waiting_profile = standing.biases, standing.waiting_profile
    seen = [bias for bias in biases if bias["observable"]]
    pending = [bias for bias in seen if bias["converged_s"] is None]
    hidden = [_hidden(bias["name"], health) for bias in biases if not bias["observable"]]
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
    waited, todo = _waited(pending, standing.slope_k_per_min)
    todo = "record longer, with the unit undisturbed" if standing.over else todo
    todo = "record again, with a longer reference" if standing.held_since is not None else todo
    kind = "observable biases" if hidden else "biases"
    return Check("wait", "converged", f"{brief} {kind} converged; {waited}", brief, todo)


def _hidden(name: str, health: Sequence[HealthEntry]) -> str:
    fault = without_bias(health, channel(name))
    return name if fault is None else f"{name} ({fault})"


def _waited(pending: Sequence[BiasSnapshot], slope: float | None) -> tuple[str, str]:
    """What the slowest bias lacks, and what helps."""
    worst = max(pending, key=_lack)
    name, unit, need, moved = worst["name"], worst["unit"], 3.0 * tolerance(worst["unit"]), moved_sd(worst)
    sd3 = filter_sd3(worst)
    if sd3 is None:
        return f"{name}: no estimate yet", ""
    if sd3 > need:
        return (
            f"{name}: 3 sd {sd3:.{BIAS_DECIMALS[unit]}f} {unit}, needs {need:g}",
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


def _lack(bias: BiasSnapshot) -> tuple[float, float]:
    sd3 = filter_sd3(bias)
    sd = math.inf if sd3 is None else sd3 / 3.0 / tolerance(bias["unit"])
    return max(sd, 1.0), abs(moved_sd(bias) or 0.0)


def worst_remainder(remainder: Sequence[RemainderSnapshot]) -> tuple[str, float] | None:
    """Channel whose 10 s means are farthest beyond noise, and how many times; None while there are too few of them."""
    known = [(r["channel"], r["ratio"]) for r in remainder if r["ratio"] is not None and r["windows"] >= FEWEST_WINDOWS]
    return max(known, key=lambda one: one[1], default=None)


def _unexplained(standing: Standing) -> Check:
    worst = worst_remainder(standing.remainder)
    if standing.departure is not None:
        brief = " ".join(standing.departure.split()[:3])
        return Check("bad", "unexplained", standing.departure, brief, TRACE_KEY)
    if worst is None:
        said = "not known: too few means of 10 s" if standing.over else "known after 30 s"
        return Check("none", "unexplained", said)
    name, ratio = worst
    level = "bad" if ratio > TOO_MUCH else "wait" if ratio > NOTICED else "good"
    said = f"{name} 10 s means {ratio:.1f} × what noise allows"
    limit = f" (limit {NOTICED:g})" if level == "good" else f" (AMBER above {NOTICED:g}, RED above {TOO_MUCH:g})"
    return Check(level, "unexplained", said + limit, f"{name} {ratio:.1f} ×", TRACE_KEY)


def _causes(causes: Sequence[CauseSnapshot]) -> Check:
    """Whether an effect that shows is larger than what a bias may be uncertain by."""
    showing = [one for one in causes if one["shows"]]
    large = [one for one in showing if over_tolerance(one)]
    if not large:
        said = "none larger than a bias may be uncertain by" if showing else "none shows"
        return Check("good", "effects", said)
    brief = f"{large[0]['channel']} {plain_names.short(large[0]['effect'])}"
    return Check("wait", "effects", large[0]["text"], brief, TRACE_KEY)


def over_tolerance(one: CauseSnapshot) -> bool:
    """Whether an effect takes readings farther from their mean than a converged bias may be uncertain by."""
    if one["effect"] == "noise_level":
        return not 1.0 / TOO_NOISY < one["size"] < TOO_NOISY
    return one["extent"] > (GYRO_TOLERANCE_DPS if one["unit"].startswith("deg") else ACCEL_TOLERANCE_MG)


def _noise(noise: NoiseSnapshot | None) -> Check | None:
    """Whether the readings' white noise is what the filter takes for it: else its standard deviations are too small."""
    if noise is None:
        return None
    name, ratio, sd = noise["name"], noise["ratio"], noise["relative_sd"]
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


def _site(biases: Sequence[BiasSnapshot]) -> Check | None:
    """Return which ± are wide because the site is not stated; it decides nothing, since the filter is as good."""
    least = 3.0 * ACCEL_TOLERANCE_MG
    wide = [bias["name"] for bias in biases if bias["observable"] and bias["site_sd3"] > least]
    if not wide:
        return None
    said = f"the ± of {' and '.join(wide)} is wide, as the site is not stated: --site LAT,LON,H"
    return Check("none", "site", said)
