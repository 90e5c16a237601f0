"""How to apply a result: formula, signs, units, axes, three lines of Python and of C, files for Kalibr and imutui."""

from collections.abc import Iterator, Sequence
from pathlib import PurePath
from typing import TYPE_CHECKING

from filters.channels import CHANNELS
from filters.tracing.sentence import OF_ONE_RUN
from filters.tracing.trace_document import TraceDocument
from imutui.jobs import linear_correction
from imutui.jobs.linear_correction import LinearCorrection
from imutui.jobs.page_data import LogData
from imutui.report import correction, kalibr
from imutui.report.blocks import Block, Code, Facts, Items, Paragraph, Section, Subheading
from imutui.verdict import sources

if TYPE_CHECKING:
    from imutui.jobs.documents import ResultDocument

TITLE = "How to apply it"
EFFECTS_FILE, KALIBR_FILE = "effects.toml", "imu.yaml"
_MOST_LINES = 40


def of_replay(d: "ResultDocument", log: LogData) -> Section:
    """How to apply a replay's biases, and effects if it took any.

    `d`: in which a filter ran.
    `log`: what the log adds.
    """
    biases = [*d["final"]["gyro_bias_dps"], *d["final"]["accel_bias_mg"]]
    return Section(TITLE, tuple(_replay(d, log, biases)))


def _replay(d: "ResultDocument", log: LogData, biases: Sequence[float | None]) -> Iterator[Block]:
    found = sources.of_document(d)
    if not found.passes:
        yield Paragraph(f"Not before this is mended, because the verdict is {found.word}: {sources.reasons(d)}")
    # no other reference leaves it open what the unit senses
    made = linear_correction.of_terms(biases, log.terms, of_reading=d["reference"] == "turned")
    yield _facts(made, d["accel_sign"], d["mount"])
    hidden = [name for name, bias in zip(CHANNELS, biases, strict=True) if bias is None]
    if hidden:
        yield Paragraph(f"The bias of {', '.join(hidden)} was not observable: a zero stands in its place.")
    yield from _code(made)
    name = PurePath(d["log"]).name
    yield from _yaml(log, d.get("rate_hz"), d.get("duration_s"), name)
    yield from _toml(log, bool(d["effects"]), "the log is not at hand, and the result names the states only.")


def of_trace(d: TraceDocument, log: LogData) -> Section:
    """How to apply what a trace found.

    `d`: the result.
    `log`: what the logs add.
    """
    return Section(TITLE, tuple(_trace(d, log)))


def _trace(d: TraceDocument, log: LogData) -> Iterator[Block]:
    run = d["runs"][-1]
    made = linear_correction.of_terms([0.0] * 6, log.terms)
    yield _facts(made, run.get("accel_sign"), run.get("mount"))
    if not made.bias.any():
        yield Paragraph(
            f"Constant biases differ from one power-on to the next, so that zeros stand in their place: `imutui replay"
            f" LOG --effects {EFFECTS_FILE}` estimates those of a log."
        )
    yield from _code(made)
    if events := [f for f in d["findings"] if f["effect"] in OF_ONE_RUN]:
        named = "; ".join(f"{' '.join(f['channels'])}: {f['label']}" for f in events)
        yield Paragraph(
            f"Neither these lines nor `{EFFECTS_FILE}` take out what happened once in a run, since nothing of it can be"
            f" foretold of the next: {named}."
        )
    yield from _yaml(log, run["rate_hz"], run["seconds"], log.levels_of)
    old = "the result is of an older imutui. `imutui trace` with the same logs and `-o effects.toml` writes it."
    yield from _toml(log, "effects_file" not in d, old)


def _facts(made: LinearCorrection, sign: int | None, mount: str | None) -> Facts:
    level = {-1: "reads +1 g on z", 1: "reads −1 g on z"}
    signs = "A bias is what the unit reads too much: it is subtracted."
    if sign in level:
        signs += (
            f" The accelerometer sign is {sign:+d}: this unit {level[sign]} when it is level with z down. Its specific"
            f" force is {sign:+d} times the corrected reading."
        )
    axes = "The unit's own x, y, z, as on its label, before any mounting."
    axes += f" In this log the table's x, y, z are the unit's {mount}." if mount else ""
    units = "gx, gy, gz in deg/s; ax, ay, az in g (1 g = 9.80665 m/s² unless `instrument.g_unit` says otherwise)"
    units += "; T is the temperature in the case, °C, smoothed over 5 s." if made.orders else "."
    rows = [("Formula", correction.formula(made)), ("Signs", signs), ("Units", units), ("Axes", axes)]
    if made.by_reading.any():
        name, what = ("A", "A is taken") if made.of_reading else ("M", "M is the inverse of 1 + A, and A is made")
        has = f"{what} of scale factor errors (its diagonal), cross-axis terms and sensitivity to specific force."
        rows.insert(1, (name, has))
    return Facts(tuple(rows))


def _code(made: LinearCorrection) -> Iterator[Block]:
    yield Subheading("Three lines of Python, `reading` being an array of gx, gy, gz, ax, ay, az")
    yield Code(correction.python(made))
    yield Subheading("The same in C")
    yield Code(correction.c_lines(made))
    if made.left_out:
        yield Paragraph(
            "These lines leave out what takes more than a reading and its temperature (the motion, the past, or a drift"
            f" that has to be estimated again); `--effects {EFFECTS_FILE}` has it:"
        )
        yield Items(made.left_out)


def _yaml(log: LogData, rate_hz: float | None, seconds: float | None, name: str) -> Iterator[Block]:
    heading = f"noise of {name}, by Allan deviation of its readings"
    made = kalibr.imu_yaml(log.levels, rate_hz, seconds, heading, log.terms)
    yield Subheading(f"`{KALIBR_FILE}` for Kalibr and what takes its files: the noisiest axis of each kind")
    yield Code(made.text)
    if made.lacks:
        yield Paragraph("Left out, because nothing was measured that could stand there:")
        yield Items(made.lacks)


def _toml(log: LogData, is_missing: bool, why: str) -> Iterator[Block]:
    yield Subheading(f"`{EFFECTS_FILE}` for `imutui record`, `imutui replay` and `imutui apply`")
    if log.effects:
        lines = log.effects.count("\n")
        long = f"The file has {lines} lines; it lies beside this page."
        yield Code(log.effects, long if lines > _MOST_LINES else "")
    elif is_missing:
        yield Paragraph(f"It cannot be shown: {why}")
    else:
        yield Paragraph("There is none: no effect joined the filter.")


def files(blocks: Sequence[Block]) -> dict[str, str]:
    """Texts of the section's files by name, to lie beside the page."""
    made, name = {}, ""
    for block in blocks:
        if isinstance(block, Subheading):
            name = next((n for n in (KALIBR_FILE, EFFECTS_FILE) if block.text.startswith(f"`{n}`")), "")
        elif isinstance(block, Code) and name:
            made[name] = block.text.rstrip("\n") + "\n"
    return made
