"""What a report of the tracer says of a case, compared with its truth."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from tracing_cases import CHANNELS, Case, Truth

IN_BAND = 1.2
NOISE = ("bandwidth", "noise_crosstalk")
SAME_HZ, SAME_S = 0.02, 4.0


@dataclass(frozen=True)
class Told:
    """What a report says of one truth."""

    truth: str
    names: list[str]
    channels: list[str]
    d: float
    detected: bool
    named: bool
    rival: bool  # named, or the truth is among the rivals of what is on its channel
    found: bool  # named, or something deterministic is found on its channel
    weak: bool  # named, a rival, or at least in the list of what is too weak
    listed: bool  # whether anything on its channel is found or in that list
    wrong: bool  # a finding under another name on its channel, and none under its own
    explained: bool  # its channel's status
    e10: float  # after, times the floor, the worst of its channels
    nis: float
    z: list[float]  # of parameters
    transfers: bool


@dataclass(frozen=True)
class Outcome:
    """One case."""

    name: str
    campaign: str
    seconds: float  # CPU time of the trace
    told: list[Told]
    findings: list[str]
    elsewhere: list[str]  # findings on channels that nothing was added to
    # steps there that another channel has at the same time: something happened to the unit in the recording
    shared: list[str]
    untouched: int  # number of those channels
    weak: list[str]
    drift: list[str]
    explained_out: list[str]  # channels explained with the held-out run out of its band
    limits: int
    status: dict[str, str]
    sentence: str

    @property
    def deterministic(self) -> list[str]:
        """Findings that are not of noise."""
        return [f for f in self.findings if f.split()[0] not in NOISE]

    @property
    def tones(self) -> list[str]:
        """Tones elsewhere: vibration of the site is in the recordings."""
        return [f for f in self.elsewhere if f.split()[0] == "tone"]

    @property
    def false(self) -> list[str]:
        """What is found elsewhere, but noise, tones and shared steps."""
        return [f for f in self.elsewhere if f.split()[0] not in (*NOISE, "tone") and f not in self.shared]


def scored(case: Case, document: dict[str, Any], seconds: float) -> Outcome:
    """Compare a report with the truth."""
    touched = {c for truth in case.truths for c in truth.channels}
    findings = document["findings"]
    elsewhere = [f for f in findings if not touched & set(f["channels"])]
    explained = [c for c in CHANNELS if document["status"][c] == "explained"]
    return Outcome(
        case.name,
        case.campaign,
        seconds,
        [told_of(truth, document, case) for truth in case.truths],
        [short(f) for f in findings],
        [short(f) for f in elsewhere],
        [short(f) for f in elsewhere if _is_shared(f, findings)],
        len(CHANNELS) - len(touched),
        [
            f"{w['effect']} {','.join(w['channels'])} {w['score']:.0f}/{w['guarded_score']:.0f}"
            for w in document["weak"]
        ],
        [f"{d['kind']} {','.join(d['channels'])}" for d in document["drift"]],
        [c for c in explained if _figure(document, "e10", c) > _limit(document, c)],
        len(document["limits"]),
        document["status"],
        document["sentence"],
    )


def _is_shared(finding: dict[str, Any], findings: list[dict[str, Any]]) -> bool:
    """Whether a step is one of several channels: told as common, or another channel steps at the same time."""
    if finding["effect"] != "step":
        return False
    own = finding["shape"]
    others = [f for f in findings if f["effect"] == "step" and f["channels"] != finding["channels"]]
    return finding["common"] is not None or any(
        f["shape"]["run"] == own["run"] and abs(f["shape"]["at_s"] - own["at_s"]) < SAME_S for f in others
    )


def short(finding: dict[str, Any]) -> str:
    """A finding in a few words: effect, channels, score, rivals."""
    rivals = [r["effect"] for r in finding["rivals"]]
    text = f"{finding['effect']} {','.join(finding['channels'])} {finding['score']:.0f}"
    return text + (f" or {'/'.join(rivals)}" if rivals else "")


def told_of(truth: Truth, document: dict[str, Any], case: Case) -> Told:
    """What a report says of one of a case's truths."""
    here = [f for f in document["findings"] if set(f["channels"]) & set(truth.channels)]
    own = [f for f in here if f["effect"] in truth.names and _same_tone(f, truth)]
    named = bool(own) or _elsewhere(truth, document)
    deterministic = [f for f in here if f["effect"] not in NOISE]
    weak = [w for w in document["weak"] if set(w["channels"]) & set(truth.channels)]
    rivals = any(r["effect"] in truth.names for f in here for r in f["rivals"])
    status = {document["status"][c] for c in truth.channels}
    # what does not carry over spoils the held-out run of its channel whatever is found
    lost = {c for other in case.truths if other is not truth and not other.transfers for c in other.channels}
    judged = [c for c in truth.channels if c not in lost]
    flagged = (
        bool(here)
        or any(set(x["channels"]) & set(truth.channels) for x in (*document["drift"], *document["lines"]))
        or any(x["channel"] in truth.channels for x in document["remainder"])
        or "unexplained" in status
    )
    if truth.place in ("integrity", "noise_level"):
        flagged = any(set(x["channels"]) & set(truth.channels) for x in document[truth.place])
    return Told(
        truth.text,
        sorted(truth.names),
        list(truth.channels),
        truth.d,
        flagged or named,
        named,
        named or rivals,
        bool(deterministic) or named,
        named or rivals or any(w["effect"] in truth.names for w in weak),
        bool(deterministic) or bool(weak) or named,
        bool(deterministic) and not named,
        "explained" in status,
        max((_figure(document, "e10", c) for c in judged), default=np.nan),
        max((_figure(document, "nis", c) for c in judged), default=np.nan),
        _z(truth, own),
        truth.transfers,
    )


def _elsewhere(truth: Truth, document: dict[str, Any]) -> bool:
    """Whether one of the lists beside the findings has it."""
    where = set(truth.channels)
    if truth.hz > 0.0:
        for line in document["lines"]:
            hz = [line["hz"] * n for n in line["harmonics"]]
            if where & set(line["channels"]) and min(abs(f / truth.hz - 1.0) for f in hz) < SAME_HZ:
                return True
        return False
    match truth.place:
        case "drift":
            return any(where & set(x["channels"]) and x["kind"] in truth.names for x in document["drift"])
        case "integrity":
            return any(where & set(x["channels"]) and x["effect"] in truth.names for x in document["integrity"])
        case "noise_level":
            return any(where & set(x["channels"]) and x["driver"] in truth.names for x in document["noise_level"])
    return False


def _same_tone(finding: dict[str, Any], truth: Truth) -> bool:
    if truth.hz <= 0.0:
        return True
    return abs(float(finding["shape"].get("hz", 0.0)) / truth.hz - 1.0) < SAME_HZ


def _z(truth: Truth, own: list[dict[str, Any]]) -> list[float]:
    """Errors of parameters over their standard deviations."""
    if not own:
        return []
    found = {p["name"]: p for p in own[0]["params"]}
    return [
        float((found[name]["value"] - value) / found[name]["sd"])
        for name, value in truth.parameters.items()
        if name in found and found[name]["sd"]
    ]


def _figure(document: dict[str, Any], metric: str, channel: str) -> float:
    """A figure after, over its floor."""
    return max(
        (x["after_x_floor"] for x in document["error"] if x["metric"] == metric and x["channel"] == channel),
        default=float("nan"),
    )


def _limit(document: dict[str, Any], channel: str) -> float:
    for x in document["error"]:
        if x["metric"] == "e10" and x["channel"] == channel:
            return max(IN_BAND, float(x["floor_band95"][1] / x["floor"]))
    return float("inf")
