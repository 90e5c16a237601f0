"""Rules of `check` on the file: its bytes, its end, its counts, what belongs to a log."""

from collections.abc import Callable, Iterator

from filters.errors import InputError
from imutui.jobs.check_context import SHOWN, CheckContext, Finding, cut_end, lossy, place
from imutui.jobs.quantities import plural
from imutui.logbook import checksum_file, effects_file, reference_file, scan, schemas, summary
from imutui.logbook.audit import Audit


def _bytes(log: CheckContext) -> Iterator[Finding]:
    """Damage between the file's first byte and its last."""
    found = log.found
    costly = lossy(found)
    for d in costly[:SHOWN]:
        what = f"Part of the file cannot be read: {d.why}."
        yield Finding("damage", what, place(d, log.start_ns), log.recover())
    if len(costly) > SHOWN:
        yield Finding("damage", f"{len(costly) - SHOWN} more parts cannot be read.", "all over the file", log.recover())
    if found.end.checksum_wrong:
        yield Finding(
            "checksum",
            "The checksum over all data is wrong, though each chunk's is right: metadata was changed after recording.",
            "outside of the chunks",
            "Compare the session with your notes (`imutui info`), or go back to another copy.",
        )
    if found.repeated:
        yield Finding("repeated", f"{plural(found.repeated, 'chunk')} stand there twice.", "", log.recover())


def _sum(log: CheckContext) -> Iterator[Finding]:
    """Whether the bytes are those that the file was finished with, where its SHA-256 stands beside it."""
    beside = checksum_file.path_of(log.found.path)
    try:
        told = checksum_file.read(log.found.path)
    except (InputError, OSError) as error:
        what = f"The SHA-256 beside the file cannot be read: {error}."
        yield Finding("sha256", what, str(beside), "Look at it, and remove it if it is not the log's.")
        return
    if told is not None and told != log.sha256:
        what = f"The file is not the one that it was when it was finished: its SHA-256 is {log.sha256}."
        yield Finding("sha256", what, f"{beside} says {told}", _CHANGED)


_CHANGED = "Go back to another copy; if you changed it yourself, `sha256sum` makes a new sum."


def _ending(log: CheckContext) -> Iterator[Finding]:
    """How the file ends."""
    found = log.found
    if found.end.cut and not found.held:
        cut = cut_end(found)
        tail = "" if cut is None else f", and its last {plural(cut.bytes, 'byte')} are no whole record"
        yield Finding(
            "unfinished",
            f"The file ends without its index{tail}: the recorder was killed, or the file was cut.",
            f"at byte {found.size:,}",
            f"It can be used as it is; {log.recover()}",
        )
    elif not found.end.cut and not found.end.finished:
        yield Finding(
            "end", "The file's end is damaged.", f"at byte {found.size - found.end.trailing:,}", log.recover()
        )
    elif found.end.finished and (
        (found.end.indexed and found.index is None) or any(d.what == "summary" for d in found.damages)
    ):
        yield Finding("index", "The index cannot be read, so viewers may refuse the file.", "at its end", log.recover())
    if indexes := [d for d in found.damages if d.what == "message index"]:
        what = f"{plural(len(indexes), 'list')} of a chunk's messages cannot be used, so viewers may miss some of them."
        where = f"first {place(indexes[0], log.start_ns)}"
        yield Finding("index", what, where, f"All messages are there; {log.recover()}")
    if found.end.trailing and found.end.finished:
        what = f"{plural(found.end.trailing, 'byte')} follow the end of the log."
        yield Finding("trailing", what, f"from byte {found.size - found.end.trailing:,} on", log.recover())


def _counts(log: CheckContext) -> Iterator[Finding]:
    """Whether all messages are there that the index and their numbers promise."""
    found, index = log.found, log.found.index
    if log.audit.homeless:
        what = f"{plural(log.audit.homeless, 'message')} belong to no topic: the list of topics is lost."
        yield Finding("homeless", what, "", log.recover())
    if index is not None and index.statistics is not None and not lossy(found):
        told = index.statistics.message_count
        have = sum(run.count for run in log.audit.messages.values()) + log.audit.homeless
        if told != have:
            what = f"The index counts {plural(told, 'message')}, the file holds {have:,}."
            yield Finding("count", what, "", log.recover())
    if not log.audit.session:
        return
    yield from _numbers(log)


def _numbers(log: CheckContext) -> Iterator[Finding]:
    """The messages' own numbers, which imutui counts from 0 on each topic."""
    missing: dict[str, int] = {}
    first: list[int] = []
    for topic, run in log.audit.messages.items():
        if run.again_ns is not None:
            what = f"{topic}: the messages' numbers go back or stand twice."
            yield Finding("sequence", what, f"first {log.at(run.again_ns)}", _TWICE)
            continue
        run = run.since_zero
        if run.missing_ns is not None:
            missing[topic] = run.missing
            first.append(run.missing_ns)
    if missing:
        each = ", ".join(f"{n:,} of {topic}" for topic, n in missing.items())
        yield Finding(
            "sequence",
            f"Messages are missing by their numbers: {each}.",
            f"just {log.at(min(first), 'before')}",
            _LOST_IN_FILE,
        )


_LOST_IN_FILE = "They are gone; a replay predicts through the gap. Keep to the part before or after it if it matters."
_TWICE = "A replay refuses samples that stand twice. Go back to another copy of the file."


def _decoding(log: CheckContext) -> Iterator[Finding]:
    """Messages that are not what their topic says."""
    total = log.audit.undecodable_count
    if total:
        first = log.audit.undecodable[:1]
        where = f"{first[0][0]}, first {log.at(first[0][1])}: {first[0][2]}" if first else ""
        what = f"{plural(total, 'message')} cannot be decoded."
        yield Finding("undecodable", what, where, "A replay stops there. Write to whoever made the file.")


def _belongings(log: CheckContext) -> Iterator[Finding]:
    """Metadata and attachments."""
    a = log.audit
    if a.session_trouble:
        what = f"The session's metadata cannot be used: {a.session_trouble}."
        yield Finding("session", what, "metadata imutui.session", "Go back to another copy of the file.")
    if not a.session:
        if schemas.RAW in a.types:
            what = "The session's metadata is missing: signs, mounting and site are not known."
            yield Finding("session", what, "metadata imutui.session", "Go back to another copy of the file.")
        return
    if summary.CONFIGURATION not in a.attachments:
        yield Finding("attachment", "The configuration is missing.", f"attachment {summary.CONFIGURATION}", _NO_CURE)
    if log.found.end.finished and summary.SUMMARY not in a.attachments and scan.RECOVERED not in a.metadata:
        yield Finding("attachment", "The quality summary is missing.", f"attachment {summary.SUMMARY}", _NO_CURE)
    yield from _hashes(a)


_NO_CURE = "The samples are usable; what was set when they were recorded is only in your notes."


def _hashes(a: Audit) -> Iterator[Finding]:
    """Whether attached files are those that the session names."""
    held = a.attachments.get(effects_file.ATTACHMENT, effects_file.NONE)
    if a.session.get("effects_sha256", "") != effects_file.digest(held):
        what = "The effects file is not the one that the session names."
        where = f"attachment {effects_file.ATTACHMENT}"
        yield Finding("attachment", what, where, "Name the right one on replay: --effects FILE.")
    kind = a.session.get("reference", "")
    if kind in ("profile", "trajectory") and not any(name in a.attachments for name in reference_file.ATTACHMENTS):
        what = f'The reference is "{kind}", and the file that it comes from is missing.'
        yield Finding("reference", what, "attachment reference.toml or reference.csv", "Name it: --reference FILE.")


def _reference(log: CheckContext) -> Iterator[Finding]:
    """Whether the log says what is known of the motion."""
    # a recorder writes it once a second; a shorter log has none
    expected = bool(log.audit.session) and log.audit.samples > 0 and log.seconds_at(log.audit.last_ns) > 2.0
    if expected and schemas.REFERENCE not in log.audit.messages:
        what = "Nothing in the log says how the table stood."
        yield Finding("reference", what, f"topic {schemas.REFERENCE}", "Say it on replay: --reference level.")


RULES: tuple[Callable[[CheckContext], Iterator[Finding]], ...] = (
    _bytes,
    _sum,
    _ending,
    _counts,
    _decoding,
    _belongings,
    _reference,
)
