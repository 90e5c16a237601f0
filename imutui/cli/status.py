"""`imutui status`."""

import shutil
import sys
from collections.abc import Mapping
from typing import TYPE_CHECKING

import typer

from imutui.cli.exit_codes import INSTRUMENT, answer
from imutui.cli.options import Json, Name, OfBatch

if TYPE_CHECKING:
    from imutui.session.batch import Answer
    from imutui.session.snapshot import GuideSnapshot, Snapshot

_HOUR_S = 3600.0


def command(name: Name = None, batch: OfBatch = None, json: Json = False) -> None:
    """Say which acquisitions run: all of them, the one that is named, or the units of a batch, running or not.

    For each: instrument, state, rate, losses, the file it records to, the room on its disk, what its filter takes, and
    how far the operator has been guided.

    Example: imutui status
    """
    from imutui.session import client
    from imutui.session.batch import ENDED, SILENT, acquisition_of, ask, names, units

    if batch is not None:
        answers = units(batch) or ask(names(batch))  # which says what runs instead
        wanted = None if name is None else [acquisition_of(batch, unit) for unit in name.split(",")]
        answers = [one for one in answers if wanted is None or one.name in wanted]
    else:
        running = client.running()
        if name is not None and name not in running:
            client.attach(name)  # says what runs instead
        answers = [one for one in ask(running if name is None else [name]) if one.missing != ENDED]
    documents = [_document(one) for one in answers]
    answer(documents, lambda: _wrapped("\n".join(map(_text, answers))) or "no acquisition is running", json=json)
    if any(one.missing in (SILENT, ENDED) for one in answers):
        raise typer.Exit(INSTRUMENT)


def _wrapped(text: str) -> str:
    """Lines that fit a terminal; whole where a program or a file takes them."""
    if not sys.stdout.isatty():
        return text
    return "\n".join(_wrap(line, shutil.get_terminal_size((80, 24)).columns) for line in text.splitlines())


def _wrap(line: str, width: int) -> str:
    """A line wrapped at words, and a path that is longer than a line behind its slashes."""
    from imutui.report import wrapping
    from imutui.tui import formatting

    indent = line[: len(line) - len(line.lstrip())]
    more = f"{indent}    "
    made = wrapping.wrap(line.strip(), width, indent, more)
    return "\n".join(formatting.folded(one, width, more) for one in made)


def _document(answer: "Answer") -> Mapping[str, object]:
    from imutui.session.plan import batch_of

    if answer.snapshot is None:
        error = {"error": answer.why} if answer.why else {}
        return {"name": answer.name, "batch": batch_of(answer.name), "state": answer.missing, **error}
    return {key: value for key, value in answer.snapshot.items() if key != "series"}


def _text(answer: "Answer") -> str:
    from imutui.session.batch import CONNECTING, ENDED

    if answer.snapshot is not None:
        return "\n  ".join([_line(answer.snapshot), *_more(answer.snapshot)])
    if answer.missing == ENDED:
        return f"{answer.name}: not running. {answer.why}"
    if answer.missing == CONNECTING:
        return f"{answer.name}: connecting to its instrument"
    return f"{answer.name}: its process lives, but does not answer; it may be busy. Try again in a few seconds."


def _line(s: "Snapshot") -> str:
    from imutui.session.snapshot import unit_in_words
    from imutui.tui.messages import lost

    unit = unit_in_words(s["instrument"], s["serial_number"])
    rec = s["recording"]
    file = f"recording to {rec['path']} ({rec['seconds']:.0f} s, {rec['bytes']} bytes)" if rec else "not recording"
    measured = f"{s['measured_hz']:.2f}" if s["measured_hz"] else "–"
    return (
        f"{s['name']} (pid {s['pid']}): {unit} on {s['port']}, {s['state']},"
        f" {s['kind']}, asked {s['rate_hz']:g} Hz measured {measured}, lost {lost(s)},"
        f" bad checksums {s['bad_checksums']}{_doubled(s)}, {file}"
    )


def _doubled(s: "Snapshot") -> str:
    return f", doubled packets {s['doubled_packets']}" if s["doubled_packets"] else ""


def _more(s: "Snapshot") -> list[str]:
    from imutui.logbook.polled_rate import finding
    from imutui.tui.messages import silence

    slow = finding(s["rate_hz"], s["measured_hz"]) if s["sampling"] == "polled" else None
    # a rate that is too low now is told by its own line
    said = [text for text in s["findings"] if text != slow]
    return [line for line in (silence(s), *_health(s), slow, *said, _room(s), _filter(s), _guide(s["guide"])) if line]


def _health(s: "Snapshot") -> list[str]:
    from imutui.verdict.rules import judge

    found = judge(None, s["health"])
    return [f"{found.badge}: {check.said}" for check in found.checks if check.level != "good"]


def _room(s: "Snapshot") -> str:
    parts = [f"free {s['free_bytes'] / 1e9:.1f} GB"] if s["free_bytes"] is not None else []
    rec = s["recording"]
    if rec is not None and rec["to_full_s"] is not None and rec["bytes_per_s"] is not None:
        left = rec["to_full_s"]
        until = f"{left / 60.0:.0f} min" if left < _HOUR_S else f"{left / _HOUR_S:.1f} h"
        parts.append(f"full in {until} at {rec['bytes_per_s'] / 1e3:.1f} kB/s")
    if s["min_free_bytes"]:
        parts.append(f"recording leaves {s['min_free_bytes'] / 1e6:g} MB")
    if rec is not None and rec["part"] > 1:
        parts.append(f"part {rec['part']} of the recording")
    both = ((s["rotate_minutes"], "minutes"), (s["rotate_mb"], "MB"))
    limits = [f"{limit:g} {unit}" for limit, unit in both if limit]
    if limits:
        parts.append(f"another file after {' or '.join(limits)}")
    return ", ".join(parts)


def _filter(s: "Snapshot") -> str:
    from filters.effects import plain_names

    reference = s["reference"]
    source = f" from {reference['file']}" if reference["file"] else ""
    parts = [f"reference {reference['name']}{source}"]
    parts.append(f"effects: {'; '.join(map(plain_names.state, s['effects']))}" if s["effects"] else "no effects")
    if s["zeroing"]:
        parts.append("zeroing the rate sensors")
    return ", ".join(parts)


def _guide(guide: "GuideSnapshot | None") -> str:
    if guide is None:
        return ""
    said = {"go": "waiting for the operator at", "hold": "holding", "done": "done with", "cancelled": "cancelled at"}
    left = f", {guide['left_s']:.0f} s left" if guide["left_s"] is not None else ""
    return f"guide: {said[guide['state']]} segment {guide['segment'] + 1} of {guide['count']}{left}"
