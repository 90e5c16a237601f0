"""Standings of filters, from what a running acquisition shows and from the result of a run that is over."""

from dataclasses import replace
from typing import TYPE_CHECKING, Literal, NamedTuple

from filters import specification
from filters.channels import DPS, MG
from filters.specification import ImuSpec
from imutui.verdict.rules import TRACE_KEY, Standing, Verdict, channel, judge

if TYPE_CHECKING:
    from collections.abc import Sequence

    from filters.health.finding import HealthEntry
    from imutui.filter_snapshot import BiasSnapshot, FilterSnapshot, NoiseSnapshot
    from imutui.logbook.results import NoiseFields, ResultDocument, RunDocument, SdFields, StateFields

_AT_REST = ("level", "gravity")
_NO_FILTER = "no filter ran: readings were taken, nothing was estimated"


def of_snapshot(estimates: "FilterSnapshot") -> Standing:
    """Standing of a running filter."""
    return Standing(
        t=estimates["t"],
        biases=estimates["biases"],
        nis=estimates["nis"],
        remainder=estimates["remainder"],
        noise=estimates["noise"],
        alarms=estimates["alarms"],
        confounded=estimates["confounded"],
        slope_k_per_min=estimates["temperature_k_per_min"],
        departure=estimates["departure"],
        causes=estimates["causes"],
        held_since=estimates["held_since"],
        failure=estimates["failure"],
        waiting=estimates["waiting"],
        limits_of=estimates["limits_of"],
    )


def of_biases(standing: Standing, health: "Sequence[HealthEntry]") -> list[Verdict]:
    """Verdicts on the six biases, each by the rules on one: health, limit, convergence, effects, what is unexplained.

    A bias that cannot be seen is as one that there is no filter for, unless something on its channel is unexplained.
    """
    return [_of_bias(standing, bias, health) for bias in standing.biases]


def _of_bias(standing: Standing, bias: "BiasSnapshot", health: "Sequence[HealthEntry]") -> Verdict:
    name, departure = channel(bias["name"]), standing.departure
    alone = replace(
        standing,
        biases=[bias],
        nis={**standing.nis, "is_test": False},
        remainder=[one for one in standing.remainder if one["channel"] == name],
        causes=[one for one in standing.causes if one["channel"] == name],
        departure=departure if departure is not None and f" {name} reads " in departure else None,
        alarms=(),
        confounded=(),
        noise=None,
        slope_k_per_min=0.0,
    )
    found = judge(alone, [one for one in health if one["channel"] == name])
    return found if bias["observable"] or found.level == "bad" else replace(found, level="none")


def of_document(d: "RunDocument") -> Verdict:
    """The verdict on a live run that is over, or on a replay."""
    if "final" not in d:
        return judge(None, d["health"]) if d["health"] else _unfiltered(d["alarms"])
    return judge(
        Standing(
            t=d["duration_s"],
            biases=_snapshots(d),
            nis=d["nis"],
            remainder=d["remainder"],
            noise=noisiest(d["noise"], d["reference"]),
            alarms=d["alarms"],
            confounded=d["confounded"],
            slope_k_per_min=d["temperature_k_per_min"],
            departure=d["departure"],
            causes=d["causes"],
            held_since=d["held_since_s"],
            over=True,
            limits_of=specification_of(d).source,
        ),
        d["health"],
    )


def specification_of(d: "ResultDocument") -> ImuSpec:
    """Return the specification of the unit that a result is of; `NOT_KNOWN` of one that its log does not state."""
    return specification.of_model(d["identity"]["instrument"])


def noise_stated(d: "ResultDocument") -> tuple[str, str]:
    """Return the white noise of the unit's data sheet in words: gyros, deg/√h, and accelerometers, m/s/√h.

    Where no data sheet is known, it is what the filter expects instead.
    """
    spec = specification_of(d)
    of = "the filter expects" if spec == specification.NOT_KNOWN else f"{spec.source.removesuffix(' data sheet')}:"
    return f"{of} {spec.gyro_arw / DPS * 60.0:.3g}", f"{of} {spec.accel_vrw * 60.0:.3g}"


def noisiest(noise: "NoiseFields", reference: str) -> "NoiseSnapshot | None":
    """Gyros or accelerometers, whichever are noisier over what the filter takes for their noise; None if not known.

    Of a kind its quietest channel counts: what moves one channel alone is an effect, and no noise of the unit.
    """
    relative_sd, used = noise["relative_sd"], noise["used"]
    if reference not in _AT_REST or relative_sd is None:
        return None
    kinds = {
        "gyros": (noise["gyro_arw_deg_sqrt_h"], used["gyro_arw_deg_sqrt_h"]),
        "accelerometers": (noise["accel_vrw_mps_sqrt_h"], used["accel_vrw_mps_sqrt_h"]),
    }
    ratios: dict[str, float] = {}
    for kind, (measured, taken) in kinds.items():
        known = [of / expected for of, expected in zip(measured, taken, strict=True) if of is not None and expected]
        if known:
            ratios[kind] = min(known)
    if not ratios:
        return None
    name = max(ratios, key=ratios.__getitem__)
    return {"name": name, "ratio": ratios[name], "relative_sd": relative_sd}


def bias_limits(spec: ImuSpec) -> dict[str, float | None]:
    """Return the limits of biases by their unit, deg/s and mg; None where no data sheet is known."""
    if spec == specification.NOT_KNOWN:
        return {"deg/s": None, "mg": None}
    return {"deg/s": round(spec.gyro_bias_limit / DPS, 9), "mg": round(spec.accel_bias_limit / MG, 9)}


def _unfiltered(alarms: list[str]) -> Verdict:
    if alarms:
        return Verdict("bad", "RED", alarms[0], "imutui replay makes the estimates")
    return Verdict("none", "OFF", _NO_FILTER)


class ResultBias(NamedTuple):
    """One of the six biases of a result."""

    name: str  # such as "x gyro"
    channel: str  # gx to az
    unit: str
    value: float | None  # None where the reference does not show it, as is its standard deviation
    sd: float | None
    converged_s: float | None  # when it converged; None if it has not
    key: 'Literal["gyro_bias_dps", "accel_bias_mg"]'  # where fields of a result have it: its name, and its place there
    place: int

    def of(self, fields: "StateFields | SdFields") -> float | None:
        """The bias among other fields of a result: its truth, or its mean."""
        return fields[self.key][self.place]


def biases(d: "ResultDocument") -> list[ResultBias]:
    """Biases of gyros, then accelerometers, of a result in which a filter ran."""
    since = d["converged_s"]
    kinds: tuple[tuple[str, str, Literal["gyro_bias_dps", "accel_bias_mg"], list[float | None]], ...]
    kinds = (
        ("gyro", "deg/s", "gyro_bias_dps", since["gyro_bias"]),
        ("accel", "mg", "accel_bias_mg", since["accel_bias"]),
    )
    return [
        ResultBias(f"{axis} {kind}", f"{kind[0]}{axis}", unit, d["final"][key][i], d["sd"][key][i], times[i], key, i)
        for kind, unit, key, times in kinds for i, axis in enumerate("xyz")
    ]  # fmt: skip


def _snapshots(d: "ResultDocument") -> "list[BiasSnapshot]":
    limits = bias_limits(specification_of(d))
    site = {"gyro_bias_dps": (0.0,) * 3, "accel_bias_mg": d["site_sd_mg"]}
    return [
        {"name": b.name, "value": b.value, "sd3": None if b.sd is None else 3.0 * b.sd,
         "site_sd3": 3.0 * site[b.key][b.place], "unit": b.unit,
         "limit": limits[b.unit], "change_10s": None, "converged_s": b.converged_s, "observable": b.value is not None}
        for b in biases(d)
    ]  # fmt: skip


def headline(d: "RunDocument") -> str:
    """The verdict on a result in a line, for the head of a page: word, whether it converged, of what part, the file.

    "Converged" stands above nothing that is RED, and above a damaged file only with the part that could be read.
    """
    found = of_document(d)
    if found.word == "OFF":
        return f"no filter: {d['log']}"
    said = f"{found.word}, {found.fault}" if found.fault else found.word
    if found.level != "bad" and "final" in d:
        settled = all(check.level == "good" for check in found.checks if check.name == "converged")
        said += ", converged" if settled else ", NOT converged"
    if d["damage"] is not None and "final" in d:
        said += f" in the {d['duration_s']:.1f} s of it that can be read"
    return f"{said}: {d['log']}"


def reasons(d: "RunDocument") -> str:
    """Why the verdict on a result is what it is, and what to do: a sentence for below its headline."""
    found = of_document(d)
    todo = found.todo_at_length.replace(TRACE_KEY, "`imutui trace` looks for the cause")
    return found.followed_by(todo)


def hence(d: "RunDocument") -> str:
    """Why a command that ends with this result exits with 1: the verdict's word and reason."""
    found = of_document(d)
    return f"{found.word}: {found.reason}"
