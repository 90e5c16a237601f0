"""Results of jobs as text for a page. Pure functions."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from imutui.estimates import Bias, biases, specification_of
from imutui.report import effect_words, numbers, replay_text, trace_tables, wrapping
from imutui.report.trace_glance import Places
from imutui.tui import formatting
from imutui.tui.formatting import StyledText
from imutui.tui.pages.logs import result_plots
from imutui.tui.terminal.glyphs import choose
from imutui.tui.widgets.raster import Line
from imutui.tui.widgets.text_plot import PlotLook
from imutui.verdict import sources
from imutui.verdict.rules import SITE_NOT_STATED, nis_meaning

if TYPE_CHECKING:
    from imutui.jobs.documents import ResultDocument, TraceDocument

_GAPS = 5
_PLACES = Places(
    "w writes them beside the log, e loads them into the filter",
    "x writes that motion as a profile; 5 Table guides through it",
    "which imutui report saves",
)


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a job came to."""

    kind: str  # "trace", "replay", "info", "check" or "recover"
    title: str  # what it is of
    log: Path  # beside which files are written, and whose name they begin with; of several logs `log_files.base`
    document: Any  # JSON-ready
    text: Callable[[int], str]  # its text at a width
    # effects, experiment: TOML of a trace's effects, and of the motion that would separate its causes; empty if there
    # is none
    effects: str = ""
    experiment: str = ""
    drawn: Callable[[PlotLook], list[Line]] | None = None  # its plots; None for those of its kind

    def plots(self, look: PlotLook) -> list[Line]:
        """Lines of its plots; none of a result that has nothing to plot."""
        return result_plots.plots(self.kind, self.document, look) if self.drawn is None else self.drawn(look)


def styled(body: str) -> StyledText:
    """Text with its headings bold: lines after an empty one that are no sentences, and what is in capitals."""
    lines = body.split("\n")
    made: StyledText = []
    for number, line in enumerate(lines):
        first = number == 0 or not lines[number - 1]
        heading = first and line and not line[0].isspace()
        loud = line.lstrip().startswith(("NOT ", "ALARM", "CANNOT"))
        made += ["\n"] if number else []
        made.append((line, "bold") if heading or loud else line)
    return made


def traced(result: "TraceDocument", writing: Collection[Path] = ()) -> Callable[[int], str]:
    """Text of a trace at a width, with what is wrong with its files first; `writing` were not finished yet."""
    told = [_as_written(sentence, writing) for sentence in result["damage"]]

    def at(width: int) -> str:
        damage = "".join(f"{wrapped(sentence, width)}\n" for sentence in told)
        return damage + trace_tables.text(result, result["source"], width, _PLACES, choose().text)

    return at


def _as_written(sentence: str, writing: Collection[Path]) -> str:
    """A file that is being written is not damaged."""
    path = next((path for path in writing if sentence.startswith(str(path))), None)
    return sentence if path is None else f"{path.name} was being written: all up to its last flush is used."


def replayed(writing: Collection[Path], d: "ResultDocument", width: int) -> str:
    """A replay's result: verdict, biases against Table 1, NIS, noise, what was lost; `writing` were not finished."""
    source = specification_of(d).source.partition(" data")[0]
    rate = f"{d['rate_hz']:.2f} Hz" if d["rate_hz"] else "one sample"
    size = f"{formatting.plural(d['samples'], 'sample')}, {d['duration_s']:.1f} s at {rate}"
    lines = [
        sources.headline(d),
        sources.reasons(d),
        f"{size}, {numbers.readings(d['kind'])}, filter {d['filter']}, reference {d['reference']}",
        *([_as_written(f"{d['log']}: {d['damage']}", writing)] if d["damage"] is not None else []),
        "",
        f"{'bias':<8} {'estimate':>9} {'± 3 sd':>8} unit    {source:>8} {'of limit':>9}   converged",
    ]
    lines += [_bias(d, bias) for bias in biases(d)]
    return wrapped("\n".join([*lines, "", *_filtered(d), "", *_data(d), *_warnings(d)]), width)


def _bias(d: "ResultDocument", bias: Bias) -> str:
    unit, value, limit, nothing = bias.unit, bias.value, bias.limit, formatting.NOTHING
    if value is None:
        return f"{bias.name:<8} {nothing:>9} {nothing:>8} {unit:<6}  {replay_text.why_unseen(d, bias.channel)}"
    decimals = formatting.BIAS_DECIMALS[unit]
    when = f"at {bias.converged_s:.1f} s" if bias.converged_s is not None else "not yet"
    allowed = share = nothing
    if limit is not None:
        allowed, share = f"±{limit:g}", f"{100.0 * abs(value) / limit:.0f} %" + (" OUT" if abs(value) > limit else "")
    return (
        f"{bias.name:<8} {formatting.number(value, 9, decimals)} {formatting.number(bias.sd3, 8, decimals)} {unit:<6}"
        f"  {allowed:>8} {share:>9}   {when}"
    )


def _filtered(d: "ResultDocument") -> list[str]:
    nis, noise = d["nis"], d["noise"]
    lines = ["Filter"]
    if nis["mean"] is not None:
        lines.append(f"  NIS {nis['mean']:.4f} of {nis['dof']}: {nis_meaning(nis, whole=True)}")
    sure = numbers.noise_certainty(noise["relative_sd"])
    if sure is None:
        lines.append(f"  noise of this log: {numbers.TOO_SHORT}")
    else:
        gyro_says, accel_says = sources.noise_stated(d)
        lines.append(f"  noise of this log: gyro  {_triple(noise['gyro_arw_deg_sqrt_h'])} deg/√h ({gyro_says})")
        lines.append(f"                     accel {_triple(noise['accel_vrw_mps_sqrt_h'])} m/s/√h ({accel_says})")
        lines.append(f"                     each {sure}")
    for e in d["effects"]:
        unit = e["name"].removesuffix(")").partition(" (")[2]
        lines.append(f"  effect {effect_words.state(e['name'])}, {e['value']:.4g} ± {3.0 * e['sd']:.2g} (3 sd) {unit}")
    if d["times_real_time"]:
        lines.append(f"  {d['times_real_time']:.0f} times real time, {d['filter_s']:.1f} s of filtering")
    return lines


def _data(d: "ResultDocument") -> list[str]:
    gaps = d["gaps"]
    lines = [
        "Data",
        f"  {formatting.plural(d['lost_packets'], 'packet')} lost,"
        f" {formatting.plural(d['bad_checksums'], 'bad checksum')},"
        f" {formatting.plural(len(gaps), 'gap')}, {formatting.plural(d['rejected'], 'outlier')} left out",
    ]
    if not d["site_stated"]:
        lines.append(f"  {SITE_NOT_STATED}")
    longest = sorted(gaps, key=lambda gap: -gap["seconds"])[:_GAPS]
    lines += [f"  gap of {gap['seconds']:.3f} s at {gap['t']:.3f} s" for gap in longest]
    if len(gaps) > _GAPS:
        lines.append(f"  and {len(gaps) - _GAPS} shorter gaps")
    return lines


def _warnings(d: "ResultDocument") -> list[str]:
    above = sources.reasons(d)
    told = [f"ALARM: {alarm}" for alarm in dict.fromkeys(d["alarms"]) if alarm not in above]
    told += [f"CANNOT BE TOLD APART: {said}" for said in d["confounded"] if said not in (above, *d["alarms"])]
    return ["", *told] if told else []


def _triple(values: Sequence[float | None]) -> str:
    return " ".join(f"{formatting.NOTHING:>7}" if value is None else f"{value:7.3f}" for value in values)


def wrapped(body: str, width: int) -> str:
    """Lines of at most so many characters, the rest of each below it and as far in."""
    out = []
    for line in body.split("\n"):
        indent = line[: len(line) - len(line.lstrip())]
        for part in formatting.folded(line, width, indent + "  ").split("\n"):
            out += wrapping.wrap(part, width, subsequent_indent=indent + "  ") or [""]
    return "\n".join(out)
