"""What `info`, `check` and `recover` found, as text for a terminal or a page."""

import itertools
from collections.abc import Iterator
from pathlib import Path

from imutui.jobs.documents import CheckDocument, EventField, InfoDocument, QualityFields, RecoverDocument
from imutui.jobs.quantities import plural
from imutui.report import effect_words, identity, numbers, wrapping
from imutui.report.numbers import NOTHING

_LABEL = 13
_MARKS = 50
_TOPICS, _ADDED = 30, 5  # how many are shown
_LONGEST = 240  # characters that are shown of one value; a file of another program may have millions
_wrap = wrapping.wrap


def info_text(d: InfoDocument, width: int) -> str:
    """What is in a log."""
    lines = [d["log"]]
    for label, value in _facts(d):
        if value:
            head, under = f"{label:<{_LABEL}} ", " " * (_LABEL + 1)
            lines += _wrap(_cut(value), width, initial_indent=head, subsequent_indent=under)
    lines += _topics(d)
    lines += _happened("marks", d["marks"], width) + _happened("events", d["events"], width)
    return "\n".join(lines)


def _cut(value: str) -> str:
    if len(value) <= _LONGEST:
        return value
    return f"{value[:_LONGEST].rstrip()}… ({len(value):,} characters; --json has all)"


def check_text(d: CheckDocument, width: int) -> str:
    """Whether a log is whole: the verdict, each finding, notes."""
    count = len(d["findings"])
    verdict = "fine" if d["fine"] else f"{count} finding" if count == 1 else f"{count} findings"
    lines = [f"{verdict}: {d['log']}"]
    size = f"{d['state']}, {plural(d['samples'], 'sample')}, {numbers.duration(d['duration_s'])}"
    size += f", {plural(d['packets'], 'packet')}, {plural(d['messages'], 'message')} in {plural(d['chunks'], 'chunk')}"
    lines += _wrap(size, width)
    for number, finding in enumerate(d["findings"], 1):
        lines.append("")
        lines += _wrap(f"{number}. {finding['what']}", width, subsequent_indent="   ")
        for label, text in (("where", finding["where"]), ("next", finding["next"])):
            if text:
                lines += _wrap(f"{label}: {text}", width, initial_indent="   ", subsequent_indent="   ")
    return "\n".join(lines + _notes(d["notes"], width))


def recover_text(d: RecoverDocument, width: int) -> str:
    """What a rebuilt log holds, and what was lost."""
    verdict = "recovered" if d["complete"] else "recovered in part"
    lines = [f"{verdict}: {d['output']}"]
    size = f"{plural(d['samples'], 'sample')}, {numbers.duration(d['duration_s'])}, {plural(d['messages'], 'message')}"
    lines += _wrap(f"{size}; read back and found as written. {Path(d['log']).name} is as it was.", width)
    return "\n".join(lines + _notes(d["sentences"], width))


def _facts(d: InfoDocument) -> Iterator[tuple[str, str]]:
    state = d["state"] + (f": {d['why']}" if d["why"] else "")
    yield "file", f"{_size(d['bytes'])}, {state}"
    serial = f" #{d['serial_number']}" if d["serial_number"] else ""
    firmware = f", says {d['firmware']}" if d["firmware"] else ""
    stated = bool(d["instrument"])
    yield "instrument", f"{d['instrument'] if stated else identity.NOT_STATED}{serial}{firmware}"
    yield "found with", d["configuration"]
    yield "readings", f"{numbers.ORIGIN[d['kind']]}{': ' if d['source'] else ''}{d['source']}"
    yield "operator", d["operator"]
    yield "place", d["place"]
    yield "table", d["table"]
    yield "note", d["note"]
    for entry in d["added"][-_ADDED:]:
        yield "added later", _added(entry)
    yield "", _more(len(d["added"]) - _ADDED, "earlier note")
    # stamps of a recording made elsewhere begin where it was imported
    yield "start", "not stated" if d["sampling"] == "imported" else d["start_utc"] or ""
    yield "length", _length(d)
    yield "rate", _rate(d)
    yield "continues", f"{d['continues']}, of the same power-on" if d["continues"] else ""
    yield "after", _after(d)
    yield "without", ", ".join(d["unread_channels"])
    yield "temperature", _temperature(d["temperature_degc"])
    yield "axes", _axes(d)
    yield "site", _site(d)
    yield (
        "filter",
        f"{d['filter']}, reference {d['reference']}, measurements {d['measurements']}" if d["filter"] else "",
    )
    yield "effects", effect_words.included(d["effects"])
    yield "quality", _quality(d["quality"])
    # of a log without any bit set there is nothing to say
    words = [word for word in d["status_words"] if word["word"]]
    told = (f"{word['means']} in {word['packets']:,} of {d['packets']:,} packets" for word in words)
    yield "status (BIT)", "; ".join(told)
    yield "port", f"{d['port']} at {d['baud']:.0f} baud on {d['host']}" if d["port"] and d["baud"] else d["port"]
    yield "software", d["software"]
    yield "attached", ", ".join(f"{name} ({_size(size)})" for name, size in d["attachments"].items())
    if d["recovered"]:
        yield (
            "recovered",
            f"from {d['recovered'].get('source', NOTHING)}; lost: {d['recovered'].get('lost', NOTHING)}",
        )


def _added(entry: dict[str, str | None]) -> str:
    said = [] if entry["note"] is None else [f"note: {entry['note'] or 'none'}"]
    said += [] if entry["operator"] is None else [f"operator: {entry['operator'] or 'none'}"]
    return f"{', '.join(said)} ({entry['utc']}{', by ' if entry['by'] else ''}{entry['by']}; the log is unchanged)"


def _length(d: InfoDocument) -> str:
    if not d["samples"]:
        return "no samples"
    packets = f" of {plural(d['packets'], 'packet')}" if d["packets"] else ""
    without = f", {d['samples_without_reading']:,} without a reading" if d["samples_without_reading"] else ""
    return f"{numbers.duration(d['duration_s'] or 0.0)}, {plural(d['samples'], 'sample')}{packets}{without}"


def _after(d: InfoDocument) -> str:
    """The recording before it that it takes up after, and what has happened since."""
    since = {"process": "a crash" if d["previous_end"] != "finished" else "", "computer": "a restart of the computer"}
    why = since.get(d["restart"], "")
    return f"{d['previous']}, {d['previous_end']}{f', then {why}' if why else ''}" if d["previous"] else ""


def _rate(d: InfoDocument) -> str:
    measured = f"{d['rate_measured_hz']:.3f} Hz measured" if d["rate_measured_hz"] else "not measurable"
    asked = f", {d['rate_asked_hz']:g} Hz asked for" if d["rate_asked_hz"] else ""
    return measured + asked + (f", {d['sampling']}" if d["sampling"] else "")


def _temperature(degc: dict[str, float] | None) -> str:
    if degc is None:
        return "none in the log"
    return f"{degc['min']:.2f} to {degc['max']:.2f} degC, first {degc['first']:.2f}, last {degc['last']:.2f} degC"


def _axes(d: InfoDocument) -> str:
    if not d["mount"] or d["accel_sign"] is None:
        return ""
    ranges = (
        f", ±{d['rate_range_dps']:g} deg/s, ±{d['accel_range_g']:g} g"
        if d["rate_range_dps"] and d["accel_range_g"]
        else f", ranges {identity.NOT_STATED}"
    )
    return f"mount {d['mount']}, accelerometer sign {d['accel_sign']:+.0f}, gyro signs {d['gyro_sign']}{ranges}"


def _site(d: InfoDocument) -> str:
    if None in (d["latitude_deg"], d["longitude_deg"], d["height_m"], d["gravity_mps2"]):
        return identity.NOT_STATED
    where = f"{d['latitude_deg']:.6f}°, {d['longitude_deg']:.6f}°, {d['height_m']:.1f} m"
    where += f", gravity {d['gravity_mps2']:.5f} m/s²"
    return where if d["site_stated"] else f"{identity.NOT_STATED}; the default is assumed: {where}"


def _quality(q: QualityFields) -> str:
    told = []
    word = q.get("verdict", "RED" if q.get("alarms") else "")
    if word in ("", "GREEN", "AMBER") and "converged" in q:
        told.append(f"filter {word} {'converged' if q['converged'] else 'NOT converged'}".replace("  ", " "))
    elif word and word != "OFF":
        told.append(f"filter {word}")
    for count, word in ((q.get("lost_packets"), "packets lost"), (q.get("bad_checksums"), "wrong checksums")):
        if count is not None:
            told.append(f"{count:,} {word}")
    if "gaps" in q:
        told.append(plural(len(q["gaps"]), "gap"))
    return ", ".join(told + [f"ALARM: {alarm}" for alarm in q.get("alarms", [])])


def _topics(d: InfoDocument) -> list[str]:
    if not d["topics"]:
        return []
    first = itertools.islice(d["topics"].items(), _TOPICS)
    shown = [(_cut(topic), t["messages"], _cut(t["type"])) for topic, t in first]
    wide = max(len(topic) for topic, _, _ in shown)
    lines = ["", f"{'topic':<{wide}}  {'messages':>10}  type"]
    lines += [f"{topic:<{wide}}  {count:>10,}  {typename}" for topic, count, typename in shown]
    return lines + list(filter(None, [_more(len(d["topics"]) - _TOPICS, "topic")]))


def _more(count: int, what: str) -> str:
    return f"and {plural(count, f'more {what}')}; --json has all" if count > 0 else ""


def _happened(title: str, entries: list[EventField], width: int) -> list[str]:
    if not entries:
        return []
    lines = ["", title]
    for entry in entries[:_MARKS]:
        t = f"{entry['t']:10.3f} s" if entry["t"] is not None else f"{NOTHING:>10}  "
        when = f"{t}  {entry['utc'][11:19]}  "
        lines += _wrap(_cut(entry["text"]) or NOTHING, width, initial_indent=when, subsequent_indent=" " * len(when))
    return lines + ([f"and {len(entries) - _MARKS} more"] if len(entries) > _MARKS else [])


def _notes(sentences: list[str], width: int) -> list[str]:
    if not sentences:
        return []
    return ["", *(line for text in sentences for line in _wrap(f"- {text}", width, subsequent_indent="  "))]


def _size(n: int) -> str:
    if n < 10_000:
        return f"{n:,} bytes"
    return f"{n / 1e3:,.0f} kB" if n < 10_000_000 else f"{n / 1e6:,.1f} MB"
