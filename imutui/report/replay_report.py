"""A replay, or a live run's result, as an article: unit and files, verdict, what to do, biases, figures, method."""

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import PurePath
from typing import TYPE_CHECKING

from filters.channels import CHANNELS, DPS
from filters.effects import plain_names
from imutui.command_line import command
from imutui.estimates import Bias, biases, specification_of
from imutui.jobs.page_data import LogData
from imutui.report import (
    axes,
    data_quality,
    filter_figures,
    how_to_apply,
    identity,
    numbers,
    replay_text,
    trace_figures,
)
from imutui.report.axes import AFTER, INK
from imutui.report.blocks import Article, Block, Column, Facts, Figure, Items, Panel, Paragraph, Section, Table
from imutui.report.numbers import NOTHING
from imutui.report.replay_text import DIGITS, converged, why_unseen
from imutui.verdict import sources
from imutui.verdict.rules import SITE_NOT_STATED

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from imutui.jobs.documents import ResultDocument, RunDocument


_SQRT_HOUR = 60.0
NO_DATA = LogData()


def article(d: "RunDocument", log: LogData = NO_DATA) -> Article:
    """All that is said of a result."""
    logs = [identity.of_result(d)]
    kind = identity.kind_of(logs)
    made = [identity.section(logs, d["library"]), Section("Verdict", tuple(_verdict(d)))]
    if "final" in d:
        made += [
            Section("What to do", (Items(tuple(after_replay(d)), numbered=True),)),
            Section("Error before and after", (Paragraph(_MEANING), _biases(d))),
            Section("Figures", tuple(_figures(d, log))),
            how_to_apply.of_replay(d, log),
        ]
    made.append(data_quality.of_replay(d, log))
    if "final" in d:
        made.append(Section("Method and provenance", tuple(_method(d, log))))
    title = f"Filtered: {PurePath(d['log']).name}"
    return Article(title, kind, identity.ORIGINS[kind], tuple(made))


_MEANING = (
    "Before, a reading is wrong by the bias itself; after the bias is subtracted, by what the filter does not know of"
    " it: three standard deviations."
)


def _verdict(d: "RunDocument") -> Iterator[Block]:
    if "final" not in d:
        yield Paragraph(f"No filter ran over these {d['samples']} samples, so there is nothing to judge.")
        return
    found = sources.of_document(d)
    yield Paragraph(f"{found.word}: {sources.reasons(d)}")
    if d["alarms"]:
        yield Paragraph("ALARM: readings and model contradict each other.")
        yield Items(tuple(d["alarms"]))
    if not d["site_stated"]:
        yield Paragraph(f"{SITE_NOT_STATED[:1].upper()}{SITE_NOT_STATED[1:]}.")
    if d["damage"] is not None:
        yield Paragraph(f"The file is damaged: {d['damage']}. This is the result of the part before the damage.")
    elif not d["finished"]:
        yield Paragraph("The file is unfinished. This is the result of all up to its last flush.")
    if d["confounded"]:
        yield Paragraph("This motion does not tell apart:")
        yield Items(tuple(d["confounded"]))


def _biases(d: "ResultDocument") -> Table:
    columns = (Column("Bias"), Column("Before: the bias", "number"), Column("After: 3 sd", "number"),
               Column("Mean ± sd after convergence", "number"), Column("Converged"))  # fmt: skip
    rows, spread = [], d["spread"]
    for b in biases(d):
        if b.value is None or b.sd is None:
            rows.append((b.name, NOTHING, NOTHING, NOTHING, why_unseen(d, b.channel)))
            continue
        value, half = (f"{x:.{DIGITS[b.unit]}f} {b.unit}" for x in (b.value, 3.0 * b.sd))
        mean, sd = (b.of(spread["mean"]), b.of(spread["sd"])) if spread else (None, None)
        known = mean is not None and sd is not None
        after = f"{mean:.{DIGITS[b.unit]}f} ± {sd:.{DIGITS[b.unit]}f} {b.unit}" if known else NOTHING
        rows.append((b.name, value, half, after, converged(b.converged_s)))
    return Table(columns, tuple(rows), "In the unit's own axes and sign: corrected reading = reading − bias.")


def _figures(d: "ResultDocument", log: LogData) -> Iterator[Block]:
    for course in log.courses:
        yield filter_figures.biases(course, d["rate_hz"], "convergence")
    if found := filter_figures.nis(log.courses, "nis"):
        yield found
    yield _figure(d)
    yield from trace_figures.of_log(log.curves, specification_of(d))
    yield from (Paragraph(sentence) for sentence in log.missing)


def _figure(d: "ResultDocument") -> Figure:
    known = biases(d)
    panels = tuple(
        Panel(f"{name} biases", partial(_draw, known=own))
        for name, own in (("gyro", known[:3]), ("accelerometer", known[3:]))
    )
    return Figure(
        "biases",
        "Biases with three standard deviations",
        "A bias whose bar crosses zero is not told from none.",
        panels,
    )


def _draw(ax: "Axes", known: Sequence[Bias]) -> None:
    for i, b in enumerate(known):
        if b.value is not None and b.sd is not None:
            axes.whiskers(ax, float(i), b.value, [b.value - 3.0 * b.sd, b.value + 3.0 * b.sd], AFTER, "o")
    ax.axhline(0.0, color=INK, lw=0.6)
    axes.name(ax, "axis", known[0].unit)
    ax.set_xticks(range(3), ["x", "y", "z"])
    ax.set_xlim(-0.5, 2.5)


def _method(d: "ResultDocument", log: LogData) -> Iterator[Block]:
    yield Paragraph(
        "A 15-state Kalman filter ran over the samples of the file, in the same steps as live. ± is one standard"
        " deviation unless it says otherwise."
    )
    rows = [
        ("Filter", d["filter"]),
        ("Reference", d["reference"]),
        ("Measurements", d["measurements"] + ("" if d["seed"] is None else f", seed {d['seed']}")),
        ("Accelerometer sign", f"{d['accel_sign']:+d}"),
        ("Mounting (table x, y, z)", d["mount"]),
        ("Samples", f"{d['samples']} ({d['rejected']} updates left out as outliers)"),
        ("Lost packets, bad checksums, gaps", f"{d['lost_packets']}, {d['bad_checksums']}, {len(d['gaps'])}"),
        ("NIS", replay_text.nis(d)),
        ("Noise of this log", _noise_of(log, d) or replay_text.noise(d)),
        ("Effects in the filter", "; ".join(plain_names.state(effect["name"]) for effect in d["effects"]) or "none"),
        ("Asked for in place of the recording's own settings", _asked(d)),
        ("SHA-256 of the log", d["log_sha256"] or identity.NOT_STATED),
        ("SHA-256 of the settings", d["config_sha256"]),
        ("Result document", f"version {d['version']}, beside this page as `result.json`"),
    ]
    yield Facts(tuple(rows))


def _asked(d: "ResultDocument") -> str:
    asked = d["asked"]
    told = [f"{key} {asked[key]:g} s" for key in ("start", "end") if asked[key] is not None]
    told += [f"{key} {value}" for key, value in asked["overrides"].items()]
    if asked["reference"] is not None:
        told.append(f"a reference from a file with SHA-256 {asked['reference']}")
    if asked["effects"] is not None:
        told.append("an effects file of its own" if asked["effects"] else "no effects")
    return ", ".join(told) or "nothing"


def _noise_of(log: LogData, d: "ResultDocument") -> str:
    """White noise by Allan deviation, which `imu.yaml` has too; empty where the log is not at hand."""
    parts = []
    for name, unit, scale, channels, stated in zip(
        ("gyro", "accel"), ("deg/√h", "m/s/√h"), (_SQRT_HOUR / DPS, _SQRT_HOUR), (CHANNELS[:3], CHANNELS[3:]),
        sources.noise_stated(d), strict=True,
    ):  # fmt: skip
        known = [log.levels.get(channel) for channel in channels]
        values = [NOTHING if e is None else numbers.plus_minus(e.white * scale, e.white_sd * scale, "") for e in known]
        if any(known):
            parts.append(f"{name} {', '.join(values)} {unit} ({stated})")
    return "; ".join(parts) + (" (± 1 sd, by Allan deviation)" if parts else "")


# ------------------------------------------------------------------------------------------------------------- advice
# What to do after a replay, in the order in which to do it: sentences made of the result document alone.


def after_replay(d: "ResultDocument") -> list[str]:
    """What to do after a replay."""
    log = PurePath(PurePath(d["log"]).name)
    recover, trace = command("recover", log, "-o", "WHOLE.mcap"), command("trace", log)
    told = []
    if d["damage"] is not None:
        told.append(f"The file is damaged. `{recover}` makes a whole file of what can be read.")
    found = sources.of_document(d)
    if found.level == "bad":
        told.append(
            f"Do not use these biases as they are: readings and model contradict each other. `{trace}` looks"
            " for the cause."
        )
    elif found.passes:
        told.append(
            "Subtract the biases of the table below: corrected reading = reading − bias, in the unit's own axes."
        )
    else:
        told.append(
            "Do not use a bias that has not converged: record longer, with the unit warmed up. A bias that keeps moving"
            f" follows something; `{trace}` looks for what it is."
        )
    if hidden := ", ".join(d["unobservable"]).replace("_bias", " bias").replace("_", " "):
        told.append(
            f"To see {hidden} as well, record on a table whose attitude"
            " is known (`--reference level`, or a table profile)."
        )
    told += [f"{sentence}: another motion tells them apart." for sentence in d["confounded"]]
    if d["lost_packets"] or d["bad_checksums"]:
        told.append(
            f"{d['lost_packets']} packets were lost and {d['bad_checksums']} had bad checksums: look at cable, adapter"
            " and supply."
        )
    return told
