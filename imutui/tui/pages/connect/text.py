"""What the connect page offers and says. Pure functions."""

import re
from dataclasses import dataclass

from filters.errors import InputError
from imutui.session.plan import MIN_RATE_HZ, VIRTUAL_PORT, Driver, of_model
from imutui.session.snapshot import ProbeAnswer, Snapshot
from imutui.tui import formatting
from imutui.tui.formatting import StyledText

ABOUT = (
    "imutui records an IMU400CD or IMU381 on a turn table and estimates its biases\n"
    "while it records. Then it traces what they do not explain to a physical cause."
)
ASK_SITE = (
    "Gravity depends on it, and with it the bias of the accelerometer along the vertical:"
    " type LAT,LON,H at site. Without it (Enter again) that bias is known to ± 7.8 mg (3 sd) only."
)
WAITING = """\
Waiting for {target}: {seconds:.0f} s of at most 30 s.

The acquisition process starts, opens the port, asks the instrument who it
is (ping, version, serial number), sets the mode, and waits for data.

Esc cancels."""
ZERO_ARGUMENT = 30
"""Argument of the command `z`: 300 samples if the unit counts in tens, 3000 if in hundreds; never 0, which erases."""
ZERO_TITLE = "Zero the rate sensors?"
ZERO_TEXT = """\
The unit must stand still. It averages its three rate sensors over 300 samples (2 to 3 s; up to 25 s on units that \
count in hundreds), and takes the mean as its new zero: command z with argument 30.

What is stored is in the instrument, perhaps for good, and every later reading is shifted by it. No data come \
meanwhile; the filter begins anew."""
_NAME = 36
_LABEL, _VALUE = 12, 66
_ANSWER = 38


@dataclass(frozen=True, slots=True)
class Choice:
    """One line of the list.

    A running batch ("batch") or acquisition ("attach"), or a port ("port").
    """

    kind: str
    value: str
    label: str

    @property
    def asks(self) -> bool:
        """Whether there is a line to ask who is on it."""
        return self.kind == "port" and self.value != VIRTUAL_PORT


def parse_rate(entered: str, offer: type[Driver]) -> float:
    """Output rate in Hz; InputError with what is wrong. A decimal comma is fine."""
    bounds = f"{MIN_RATE_HZ:g} to {offer.most_rate_hz:g} Hz"
    try:
        rate = float(entered.strip().replace(",", "."))
    except ValueError:
        raise InputError(f"not a number; {bounds}") from None
    if not MIN_RATE_HZ <= rate <= offer.most_rate_hz:
        raise InputError(f"outside {bounds}")
    return rate


def rates(offer: type[Driver]) -> str:
    """Which rates a unit gives, and at which of them samples are no means of packets, where there are several."""
    bounds = f"{MIN_RATE_HZ:g} to {offer.most_rate_hz:g}"
    if len(offer.rates_hz) == 1:
        return bounds
    return f"{bounds}; unaveraged at {' '.join(f'{rate:g}' for rate in sorted(offer.rates_hz))}"


def choices(running: list[str], ports: list[tuple[str, str]]) -> list[Choice]:
    """Return the lines of the list: running batches and acquisitions, real ports, and the virtual instrument."""
    batches = dict.fromkeys(name.partition(":")[0] for name in running if ":" in name)
    found = [Choice("batch", name, f'running batch "{name}": look at all its units') for name in batches]
    alone = [name for name in running if ":" not in name]
    found += [Choice("attach", name, f'running acquisition "{name}": look at it again') for name in alone]
    found += [
        Choice("port", port, f"{formatting.port_name(port, _NAME):{_NAME}}  {about}".rstrip()) for port, about in ports
    ]
    virtual = f"{'virtual instrument':{_NAME}}  simulated IMU400CD on this machine"
    return [*found, Choice("port", VIRTUAL_PORT, virtual)]


def label(choice: Choice, answers: dict[str, str]) -> str:
    """A line of the list; what was heard on a port stands in place of its description."""
    answer = answers.get(choice.value) if choice.asks else None
    if answer is None:
        return choice.label
    return f"{formatting.port_name(choice.value, _NAME):{_NAME}}  {formatting.clipped(answer, _ANSWER)}"


def answered(found: ProbeAnswer) -> str:
    """What answers on a port that was probed, in a few words: who, or the first clause of why not."""
    who = found["firmware"] or found["instrument"] or "answers a ping"
    who = f"{who} #{found['serial_number']}" if found["serial_number"] else who
    if found["answers"]:
        return f"{who}, not usable" if found["error"] else who
    why = (found["error"] or "silent").removeprefix(found["port"])
    return re.split(r"[.:;] ", why.removeprefix(":").strip().removeprefix("is "))[0]


def likely(found: list[Choice]) -> Choice:
    """What Enter should take: a running acquisition, else an adapter, else the virtual instrument.

    Built-in ports (ttyS0) come last: most machines list them with nothing behind.
    """
    return next(c for c in found if c.kind != "port" or "ttyS" not in c.value)


def lead(found: list[Choice]) -> StyledText:
    """What this is, and what the next step is."""
    best = likely(found)
    if best.kind != "port":
        several = sum(c.kind in ("batch", "attach") for c in found) > 1
        one = "A batch is running" if best.kind == "batch" else "An acquisition is running"
        which = "Several acquisitions are running: choose one" if several else one
        return [(f"{which}. Enter looks at it.", "bold")]
    if best.value != VIRTUAL_PORT:
        return [ABOUT, "\n\n", ("Choose a port; Enter connects.", "bold"), *_demo("  No unit at hand:")]
    built_in = "only built-in ports" if sum(c.kind == "port" for c in found) > 1 else "no serial port"
    nothing = f"Nothing is connected: this machine has {built_in}.\nPlug an adapter in and it appears below."
    return [ABOUT, "\n\n", nothing, "\n", *_demo("To see the whole job now:")]


def _demo(before: str) -> StyledText:
    return [f"{before} ", (" press v for the DEMO ", "bold reverse"), " on a simulated instrument"]


def connected(now: Snapshot) -> StyledText:
    """What is connected, and how it is read."""
    reference, filter_ = now["reference"], now["filter"]
    mode = of_model(now["instrument"]).mode
    how = f"{now['rate_hz']:g} Hz, {now['sampling']}, {mode}, {now['baud']} baud"
    estimates = f"{filter_['filter']}, reference {filter_['reference']}" if filter_ else "none: record only"
    if reference["file"]:
        estimates += f" from {reference['file']}"
    if filter_ and not now["site_stated"]:
        estimates += "; the site is not stated, so the ± of the vertical accelerometer is wide"
    if now["effects"]:
        estimates += f", with {formatting.plural(len(now['effects']), 'effect')} found before"
    rows = [
        ("instrument", f"{now['instrument']} #{now['serial_number']}, firmware {now['firmware']}"),
        ("port", str(now["port"])),
        ("read at", how),
        ("filter", estimates),
        ("process", f'acquisition "{now["name"]}" of {now["owner"]}, pid {now["pid"]}; runs on without this screen'),
        ("logs in", str(now["logs"] or formatting.NOTHING)),
    ]
    made: StyledText = [("Connected.", "bold")]
    for name, value in rows:
        made += ["\n", (f"{name:{_LABEL}}", "dim"), formatting.folded(value, _VALUE).replace("\n", "\n" + " " * _LABEL)]
    return made


def next_step(now: Snapshot) -> str:
    """What to do on from here."""
    if now["recording"]:
        return (
            "It is recording. Next: 4 Filter shows how far the biases are;\n"
            "r finishes the file; 6 Logs opens and traces it."
        )
    return "Next: 2 Live shows the readings, r records them, 4 Filter shows the biases."
