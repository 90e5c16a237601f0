"""Whether a log is whole, and whether its parts agree: the file's bytes, its messages, its numbers and times.

A finding is something that a calibration should not rest on unseen; a note is worth a word and no more.
"""

from collections.abc import Callable, Iterator
from pathlib import Path

from imutui.document_shape import VERSION
from imutui.jobs import check_file
from imutui.jobs.check_context import SHOWN, CheckContext, DataRule, state_of
from imutui.jobs.check_packets import PacketSteps
from imutui.jobs.check_samples import Health, Impossible, Limits, SamplesOfPackets
from imutui.jobs.check_times import Gaps, Times
from imutui.jobs.documents import CheckDocument
from imutui.jobs.info import lacking_channels, status_words
from imutui.jobs.quantities import plural
from imutui.logbook import audit, checksum_file, reader, scan
from imutui.logbook.audit import Audit
from imutui.logbook.reading import AS_STATED, Reading

_DATA_RULES: tuple[Callable[[Audit], DataRule], ...] = (Times, Gaps, PacketSteps, SamplesOfPackets, Limits, Impossible)


def check(
    path: Path,
    progress: Callable[[float, str], None] = lambda share, text: None,
    reading: Reading = AS_STATED,
) -> CheckDocument:
    """Look a log through, finished or not.

    `progress`: called with the share done, 0 to 1, and what is being done.
    Raises UnreadableLogError if there is no such file, or it is no log at all.
    """
    found, content, rules = scan.Scan(path), Audit(), list[DataRule]()
    health: Health | None = None
    show = lambda share: progress(share, f"reading {path.name}")  # noqa: E731
    for part in audit.parts(found, content, reading, show, indexes=True):
        if health is None:
            health = Health(content)
            rules = [*(rule(content) for rule in _DATA_RULES), health]
        for rule in rules:
            rule.take(part)
    log = CheckContext(found, content, reader.sha256(path))
    findings = [finding for rule in check_file.RULES for finding in rule(log)]
    findings += [finding for rule in rules for finding in rule.findings(log)]
    progress(1.0, "done")
    return {
        "version": VERSION,
        "log": str(path.resolve()),
        "state": state_of(found),
        "fine": not findings,
        "findings": [{"code": f.code, "what": f.what, "where": f.where, "next": f.next} for f in findings],
        "health": [] if health is None else health.entries(),
        "assumed": list(content.assumed),
        "notes": list(_notes(log)),
        "bytes": found.size,
        "chunks": found.chunks,
        "messages": sum(run.count for run in content.messages.values()),
        "topics": {topic: run.count for topic, run in content.messages.items()},
        "samples": content.samples,
        "packets": content.packets,
        "duration_s": log.seconds_at(content.latest_ns) if content.samples else 0.0,
        "log_sha256": log.sha256,
    }


def _notes(log: CheckContext) -> Iterator[str]:
    a, found = log.audit, log.found
    if found.held:
        yield "A recorder is writing to it: this is how far it had come."
    if found.end.finished and not found.end.indexed:
        yield "It was written without an index, so viewers read all of it to find a topic."
    if not a.session:
        yield "Another program's file: it has no session, so only its samples were looked at."
    elif a.session.get("kind", "") not in ("measured", "simulated"):
        yield "The log does not say whether a sensor made its readings, or a simulation."
    if a.session and not a.packets:
        how = "imported" if a.session.get("sampling") == "imported" else "without packets"
        yield f"The log is {how}: there are no packets to compare the samples with."
    if checksum_file.read_or_none(found.path) == log.sha256:
        yield f"Its SHA-256 is the one in {checksum_file.path_of(found.path).name}."
    if scan.RECOVERED in a.metadata:
        yield f"It was rebuilt by `imutui recover`; lost then: {a.metadata[scan.RECOVERED].get('lost', 'not said')}"
    if not a.samples:
        yield "It holds no samples."
    elif lacking := lacking_channels(a):
        yield f"It holds no readings of {', '.join(lacking)}: these channels are left out of replay and trace."
    if a.samples and a.temperatures is None:
        yield "It holds no temperature: effects of temperature can't be traced in it."
    for word, said, count in status_words(a):
        if word:
            yield (
                f"The unit's status word (BIT) was {said} in {count:,} of {a.packets:,} packets; readings count"
                " whatever it says."
            )
    if found.unknown:
        yield f"{plural(found.unknown, 'record')} of kinds that the format leaves to others were passed over."
    told = [event for event in a.events if event.name not in ("mark", "gap") and _worth_a_word(event.text)]
    for event in told[:SHOWN]:
        yield f"{log.at(event.stamp_ns)}: {event.text}"


def _worth_a_word(text: str) -> bool:
    # packets that were lost are a finding already, and status words are counted
    return not text.startswith(
        ("connected to", "recording to", "finished", "the unit's status word")
    ) and not text.endswith("packets lost")
