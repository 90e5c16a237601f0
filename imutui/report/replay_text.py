"""The result of a live run or a replay as text for a terminal and for the screen; its page has parts of it too."""

from typing import TYPE_CHECKING

from filters.health.finding import without_bias
from imutui.estimates import biases, specification_of
from imutui.jobs.quantities import plural
from imutui.report import effect_words, numbers, plain
from imutui.report.blocks import Block, Column, Paragraph, Table
from imutui.report.numbers import NOTHING
from imutui.verdict import sources
from imutui.verdict.rules import SITE_NOT_STATED

if TYPE_CHECKING:
    from imutui.jobs.documents import ResultDocument, RunDocument

_GAPS = 5
DIGITS = {"deg/s": 4, "mg": 3}  # of biases in tables, by their unit


def text(d: "RunDocument", width: int) -> str:
    """Return a result as lines of at most `width` characters: verdict, biases, noise, losses, alarms."""
    if "final" not in d:
        said = [f"{d['log']}: {d['samples']} samples, no filter"]
        said += [sources.reasons(d)] if d["alarms"] or d["health"] else []
        lines = plain.lines(map(Paragraph, said), width)
        return f"{sources.headline(d)}\n{lines}" if d["health"] else lines
    rate = f"{d['rate_hz']:.2f} Hz" if d["rate_hz"] else "one sample"
    size = f"{plural(d['samples'], 'sample')}, {d['duration_s']:.1f} s at {rate}"
    about = f"{size}, {numbers.readings(d['kind'])}, filter {d['filter']}, reference {d['reference']}"
    blocks: list[list[Block]] = [[Paragraph(sources.reasons(d)), Paragraph(about)], [_biases(d)]]
    blocks.append([Paragraph(said) for said in _data(d)])
    # the file's name is left whole, so that it can be copied
    return "\n".join([sources.headline(d), "\n\n".join(plain.lines(part, width) for part in blocks)])


def _biases(d: "ResultDocument") -> Table:
    every, truth = biases(d), d["truth"]
    limits = any(b.limit is not None for b in every)
    source = specification_of(d).source.partition(" data")[0]
    columns = [Column("bias"), Column("estimate", "number"), Column("± 3 sd", "number"), Column("unit")]
    columns += [Column(source, "number"), Column("of limit", "number")] if limits else []
    columns += [Column("converged"), *([Column("truth", "number")] if truth else [])]
    rows = []
    for b in every:
        digits = DIGITS[b.unit]
        estimate = [NOTHING, NOTHING] if b.value is None else [f"{one:.{digits}f}" for one in (b.value, b.sd3)]
        limit = [] if b.limit is None else [f"±{b.limit:g}", _of_limit(b.value, b.limit)]
        since = why_unseen(d, b.channel) if b.value is None else converged(b.converged_s)
        true = [f"{b.of(truth):.{digits}f}"] if truth else []
        rows.append((b.name, *estimate, b.unit, *limit, since, *true))
    return Table(tuple(columns), tuple(rows))


def _of_limit(value: float | None, limit: float) -> str:
    return NOTHING if value is None else f"{100.0 * abs(value) / limit:.0f} %" + (" OUT" if abs(value) > limit else "")


def why_unseen(d: "ResultDocument", channel: str) -> str:
    """Return why a result has no bias of a channel."""
    fault = without_bias(d["health"], channel)
    return "not observable with this reference" if fault is None else f"never: {fault}"


def converged(since: float | None) -> str:
    """Return when a bias converged, in words."""
    return "not yet" if since is None else f"at {since:.0f} s"


def nis(d: "ResultDocument") -> str:
    """Return the mean NIS and what it means."""
    mean, (low, high) = d["nis"]["mean"], d["nis"]["band95"] or (None, None)
    if mean is None:
        return "none"
    is_test = d["nis"]["is_test"] and low is not None and high is not None
    meaning = f"95 % band {low:.3g} to {high:.3g}" if is_test else f"no test: {d['nis']['why']}"
    return f"{mean:.3g} of {d['nis']['dof']:.4g} degrees of freedom ({meaning})"


def noise(d: "ResultDocument") -> str:
    """Return the white noise measured on the log, beside the data sheet's, and how certain it is."""
    of, sure = d["noise"], numbers.noise_certainty(d["noise"]["relative_sd"])
    if sure is None:
        return numbers.TOO_SHORT
    gyro, accel = sources.noise_stated(d)
    return (
        f"gyro {_triple(of['gyro_arw_deg_sqrt_h'])} deg/√h ({gyro}),"
        f" accel {_triple(of['accel_vrw_mps_sqrt_h'])} m/s/√h ({accel}), each {sure}"
    )


def _data(d: "ResultDocument") -> list[str]:
    out = [f"NIS {nis(d)}"] if d["nis"]["mean"] is not None else []
    out.append(f"noise of this log: {noise(d)}")
    used = d["noise"]["used"]
    if used["source"] == "log":
        walk = f"gyro {_triple(used['gyro_walk_dps_sqrt_h'], 3)} deg/s/√h"
        walk += f", accel {_triple(used['accel_walk_mps2_sqrt_h'], 4)} m/s²/√h"
        white = f"gyro {_triple(used['gyro_arw_deg_sqrt_h'])} deg/√h"
        white += f", accel {_triple(used['accel_vrw_mps_sqrt_h'])} m/s/√h"
        out.append(f"noise used, by Allan deviation: {white}; drift of the biases: {walk}")
    if not d["site_stated"]:
        out.append(SITE_NOT_STATED)
    if d["rejected"]:
        out.append(f"{plural(d['rejected'], 'update')} left out as outliers")
    if d["gaps"]:
        longest = sorted(d["gaps"], key=lambda gap: -gap["seconds"])[:_GAPS]
        each = ", ".join(f"{gap['seconds']:.3f} s at {gap['t']:.3f} s" for gap in longest)
        out.append(f"{plural(len(d['gaps']), 'gap')}, longest {each}")
    if d["lost_packets"] or d["bad_checksums"]:
        out.append(f"{plural(d['lost_packets'], 'packet')} lost, {plural(d['bad_checksums'], 'bad checksum')}")
    out += [f"effect {effect_words.estimate(effect)} (3 sd)" for effect in d["effects"]]
    # names of states are channels, effect, parameter, unit
    remembers = any({"hysteresis", "thermal_lag"} & {*effect["name"].split()} for effect in d["effects"])
    if remembers and not d["history_known"]:
        out.append(
            "effects of this filter remember temperature, and what came before this log is not known: they begin as if"
            " it had rested, and biases do not compare with those of another log"
        )
    if d["read_s"] and d["times_real_time"]:
        out.append(f"{d['times_real_time']:.0f} times real time, {d['filter_s']:.1f} s of filtering")
    above = sources.reasons(d)
    out += [f"CANNOT BE TOLD APART: {said}" for said in d["confounded"] if said not in (above, *d["alarms"])]
    return out + [f"ALARM: {alarm}" for alarm in dict.fromkeys(d["alarms"]) if alarm not in above]


def _triple(values: list[float | None], digits: int = 2) -> str:
    return " ".join(NOTHING if v is None else f"{v:.{digits}f}" for v in values)
