"""How to apply a result: formula, signs, units, axes, three lines of Python and of C, files for Kalibr and imutui."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePath
from typing import TYPE_CHECKING

from filters.channels import CHANNELS
from filters.effects import plain_names
from filters.effects.inputs import REFERENCE_DEGC
from filters.tracing.sentence import OF_ONE_RUN
from filters.tracing.trace_document import TraceDocument
from filters.types import Array
from imutui.command_line import command
from imutui.estimates import biases
from imutui.jobs import linear_correction
from imutui.jobs.linear_correction import LinearCorrection, Term
from imutui.jobs.page_data import LogData
from imutui.jobs.residuals import NoiseLevel
from imutui.report.blocks import Block, Code, Facts, Items, Paragraph, Section, Subheading
from imutui.verdict import sources

if TYPE_CHECKING:
    from imutui.jobs.documents import ResultDocument


TITLE = "How to apply it"
EFFECTS_FILE, KALIBR_FILE = "effects.toml", "imu.yaml"
_MOST_LINES = 40


def of_replay(d: "ResultDocument", log: LogData) -> Section:
    """How to apply a replay's biases, and effects if it took any."""
    return Section(TITLE, tuple(_replay(d, log)))


def _replay(d: "ResultDocument", log: LogData) -> Iterator[Block]:
    values = [bias.value for bias in biases(d)]
    found = sources.of_document(d)
    if not found.passes:
        yield Paragraph(f"Not before this is mended, because the verdict is {found.word}: {sources.reasons(d)}")
    # no other reference leaves it open what the unit senses
    made = linear_correction.of_terms(values, log.terms, of_reading=d["reference"] == "turned")
    yield _facts(made, d["accel_sign"], d["mount"])
    hidden = [name for name, bias in zip(CHANNELS, values, strict=True) if bias is None]
    if hidden:
        yield Paragraph(f"The bias of {', '.join(hidden)} was not observable: a zero stands in its place.")
    yield from _code(made)
    name = PurePath(d["log"]).name
    yield from _yaml(log, d["rate_hz"], d["duration_s"], name)
    yield from _toml(log, has_states=bool(d["effects"]))


def of_trace(d: TraceDocument, log: LogData) -> Section:
    """How to apply what a trace found."""
    return Section(TITLE, tuple(_trace(d, log)))


def _trace(d: TraceDocument, log: LogData) -> Iterator[Block]:
    run = d["runs"][-1]
    made = linear_correction.of_terms([0.0] * 6, log.terms)
    yield _facts(made, run["accel_sign"], run["mount"])
    if not made.bias.any():
        yield Paragraph(
            f"Constant biases differ from one power-on to the next, so that zeros stand in their place: `"
            f"{command('replay', 'LOG', '--effects', EFFECTS_FILE)}` estimates those of a log."
        )
    yield from _code(made)
    if events := [f for f in d["findings"] if f["effect"] in OF_ONE_RUN]:
        named = "; ".join(f"{' '.join(f['channels'])}: {f['label']}" for f in events)
        yield Paragraph(
            f"Neither these lines nor `{EFFECTS_FILE}` take out what happened once in a run, since nothing of it can be"
            f" foretold of the next: {named}."
        )
    yield from _yaml(log, run["rate_hz"], run["seconds"], log.levels_of)
    yield from _toml(log, has_states=False)


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
    rows = [("Formula", formula(made)), ("Signs", signs), ("Units", units), ("Axes", axes)]
    if made.by_reading.any():
        name, what = ("A", "A is taken") if made.of_reading else ("M", "M is the inverse of 1 + A, and A is made")
        has = f"{what} of scale factor errors (its diagonal), cross-axis terms and sensitivity to specific force."
        rows.insert(1, (name, has))
    return Facts(tuple(rows))


def _code(made: LinearCorrection) -> Iterator[Block]:
    yield Subheading("Three lines of Python, `reading` being an array of gx, gy, gz, ax, ay, az")
    yield Code(python(made))
    yield Subheading("The same in C")
    yield Code(c_lines(made))
    if made.left_out:
        yield Paragraph(
            "These lines leave out what takes more than a reading and its temperature (the motion, the past, or a drift"
            f" that has to be estimated again); `--effects {EFFECTS_FILE}` has it:"
        )
        yield Items(made.left_out)


def _yaml(log: LogData, rate_hz: float | None, seconds: float | None, name: str) -> Iterator[Block]:
    heading = f"noise of {name}, by Allan deviation of its readings"
    made = imu_yaml(log.levels, rate_hz, seconds, heading, log.terms)
    yield Subheading(f"`{KALIBR_FILE}` for Kalibr and what takes its files: the noisiest axis of each kind")
    yield Code(made.text)
    if made.lacks:
        yield Paragraph("Left out, because nothing was measured that could stand there:")
        yield Items(made.lacks)


def _toml(log: LogData, *, has_states: bool) -> Iterator[Block]:
    yield Subheading(f"`{EFFECTS_FILE}` for `imutui record`, `imutui replay` and `imutui apply`")
    if log.effects:
        lines = log.effects.count("\n")
        long = f"The file has {lines} lines; it lies beside this page."
        yield Code(log.effects, long if lines > _MOST_LINES else "")
    elif has_states:
        yield Paragraph("It cannot be shown: the log is not at hand, and the result names the states only.")
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


# --------------------------------------------------------------------------------------------------------- correction
# A correction of readings as arithmetic: what three lines of a program can do.


def formula(c: LinearCorrection) -> str:
    """As people write it."""
    terms = ["reading − bias"]
    terms += ["A · reading"] if c.of_reading and c.by_reading.any() else []
    terms += [f"K{n} · (T − {REFERENCE_DEGC:g} °C){'²³'[n - 2] if n > 1 else ''}" for n in range(1, c.orders + 1)]
    inner = " − ".join(terms)
    return f"corrected = M · ({inner})" if _is_product(c) else f"corrected = {inner}"


def python(c: LinearCorrection) -> str:
    """Three lines of Python: `reading` and `temperature` in, `corrected` out."""
    names, values, steps = ["bias"], [_array(c.bias)], ["reading - bias"]
    if c.by_reading.any():
        names.append("A" if c.of_reading else "M")
        values.append(_array(c.by_reading if c.of_reading else c.matrix))
    if c.of_reading and c.by_reading.any():
        steps.append("A @ reading")
    for n in range(c.orders):
        names.append(f"K{n + 1}")
        values.append(_array(c.by_temperature[n]))
        steps.append(f"K{n + 1} * (temperature - {REFERENCE_DEGC})" + (f"**{n + 1}" if n else ""))
    constants = f"{', '.join(names)} = {', '.join(values)}"
    inner = " - ".join(steps)
    return "\n".join(["import numpy as np", constants, f"corrected = {f'M @ ({inner})' if _is_product(c) else inner}"])


def c_lines(c: LinearCorrection) -> str:
    """Three lines of C: `reading` (6) and `temperature` in, `corrected` (6) out."""
    j = "j" if _is_product(c) else "i"
    constants = [f"bias[6] = {_list(c.bias, '{}')}"]
    steps = [f"reading[{j}] - bias[{j}]"]
    if c.by_reading.any():
        rows = _list(c.by_reading if c.of_reading else c.matrix, "{}")
        constants.append(f"{'A' if c.of_reading else 'M'}[6][6] = {rows}")
    if c.of_reading:
        steps += [f"A[i][{k}] * reading[{k}]" for k in range(6) if c.by_reading[:, k].any()]
    for n in range(c.orders):
        constants.append(f"K{n + 1}[6] = {_list(c.by_temperature[n], '{}')}")
        steps.append(" * ".join([f"K{n + 1}[{j}]", *["dT"] * (n + 1)]))
    first = f"static const double {', '.join(constants)};"
    second = f"double corrected[6]{' = {0}' if _is_product(c) else ''}"
    second += f", dT = temperature - {REFERENCE_DEGC};" if c.orders else ";"
    third = "for (int i = 0; i < 6; i++) "
    if _is_product(c):
        third += f"for (int j = 0; j < 6; j++) corrected[i] += M[i][j] * ({' - '.join(steps)});"
    else:
        third += f"corrected[i] = {' - '.join(steps)};"
    return "\n".join([first, second, third])


def _is_product(c: LinearCorrection) -> bool:
    return bool(c.by_reading.any()) and not c.of_reading


def _array(values: Array) -> str:
    return f"np.array({_list(values)})"


def _list(values: Array, ends: str = "[]") -> str:
    """Numbers as a program has them, of a matrix row by row."""
    inner = (_list(row, ends) for row in values) if values.ndim > 1 else map(_number, values)
    return ends[0] + ", ".join(inner) + ends[1]


def _number(value: float) -> str:
    """As many digits as a reading can ever use; a point or an exponent, so that C takes it for a double."""
    text = f"{value:.9g}"
    return text if any(sign in text for sign in ".e") else text + ".0"


# ------------------------------------------------------------------------------------------------------------- kalibr
# The file of noise that users of Kalibr know (`imu.yaml`), and why some of its values are left out.

TOPIC = "/imu/data_raw"
_KINDS = (
    ("accelerometer", ("ax", "ay", "az"), "m/s^2", "m/s^3"),
    ("gyroscope", ("gx", "gy", "gz"), "rad/s", "rad/s^2"),
)


@dataclass(frozen=True, slots=True)
class KalibrFile:
    """Text of a file, and what it lacks."""

    text: str  # YAML
    lacks: tuple[str, ...]  # sentences on values that the log cannot give


def imu_yaml(
    levels: Mapping[str, NoiseLevel],
    rate_hz: float | None,
    seconds: float | None,
    heading: str,
    terms: Iterable[Term] = (),
) -> KalibrFile:
    """Noise of a unit as Kalibr takes it: the noisiest axis of each kind.

    `levels`: by channel; empty where nothing was measured.
    `terms`: effects that the readings have in them: a walk cannot be told from what moves a channel in another way.
    """
    lines, lacks, terms = [f"# {heading}"], [], tuple(terms)
    for kind, channels, white_unit, walk_unit in _KINDS:
        known = {name: levels[name] for name in channels if name in levels}
        if not known:
            lacks.append(f"{kind}_noise_density and {kind}_random_walk: this log does not tell the noise.")
            continue
        noisiest = max(known, key=lambda name: known[name].white)
        level = known[noisiest]
        lines.append(
            f"{kind}_noise_density: {level.white:.3e}  # {white_unit}/sqrt(Hz), {noisiest}, +- {level.white_sd:.1e}"
        )
        walking = max(known, key=lambda name: known[name].walk)
        if (moved := _moved(terms, channels)) and known[walking].walk > 0.0:
            lacks.append(
                f"{kind}_random_walk: the readings have errors in them that look like a walk ({moved}). A report on the"
                " log that `imutui apply` makes has the walk of what is left."
            )
        elif known[walking].walk > 0.0 and any(level.follows_temperature for level in known.values()):
            lacks.append(
                f"{kind}_random_walk: the readings follow the temperature, and a walk is not told from that."
                " `imutui trace` finds what temperature does."
            )
        elif known[walking].walk > 0.0:
            lines.append(f"{kind}_random_walk: {known[walking].walk:.3e}  # {walk_unit}/sqrt(Hz), {walking}")
        else:
            length = "" if seconds is None else f" of {seconds:.0f} s"
            lacks.append(f"{kind}_random_walk: no random walk shows in this log{length}; a longer one is needed.")
    lines.append(f"rostopic: {TOPIC}")
    if rate_hz is None:
        lacks.append("update_rate: this log does not tell it.")
    else:
        lines.append(f"update_rate: {rate_hz:.2f}  # Hz")
    return KalibrFile("\n".join(lines), tuple(lacks))


def _moved(terms: Iterable[Term], channels: Iterable[str]) -> str:
    """What moves channels of a kind beside a constant bias and a walk, in words; empty for nothing."""
    own = set(channels)
    named = (
        plain_names.on_channels(term.effect, term.channels)
        for term in terms
        if own.intersection(term.channels) and term.effect not in ("bias", "random_walk")
    )
    return "; ".join(dict.fromkeys(named))
