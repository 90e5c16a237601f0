"""A finished, indexed log from an unfinished or damaged one; the source is never written to."""

import contextlib
from collections.abc import Callable
from pathlib import Path

from filters.errors import InputError
from imutui.document_shape import VERSION
from imutui.jobs.check_context import cut_end, lossy, place, since, state_of
from imutui.jobs.documents import DamageField, RecoverDocument
from imutui.jobs.quantities import plural
from imutui.logbook import added_notes, atomic_file, checksum_file, file_lock, pieces, reader, schemas
from imutui.logbook import recover as rebuilding
from imutui.logbook.log_stream import MODE
from imutui.logbook.pieces import Outline
from imutui.logbook.reader import UnreadableLogError
from imutui.logbook.recover import RebuiltContent
from imutui.logbook.scan import Scan
from imutui.logbook.session_info import METADATA

_WRITTEN = 0.9
_SHOWN = 20


def recover(
    path: Path,
    output: Path,
    overwrite: bool = False,
    progress: Callable[[float, str], None] = lambda share, text: None,
    mode: int = MODE,
) -> RecoverDocument:
    """Rebuild a log that is unfinished, damaged or whole.

    `output`: the file to make; there whole or not at all.
    `progress`: called with the share done, 0 to 1, and what is being done.
    `mode`: permissions of the file, and of its sum beside it.
    Raises UnreadableLogError if there is no such file, or nothing whole in it.
    Raises InputError if the source is being written, or is the output.
    Raises FileExistsError if the output exists and may not be replaced.
    Raises NotAsWrittenError if it does not read back as it was written; nothing is left then.
    """
    _refuse(path, output)
    found, digest = Scan(path), reader.sha256(path)
    with atomic_file.part_of(output, overwrite=overwrite, mode=mode) as part:
        kept = rebuilding.rebuild(
            found,
            part,
            lambda kept: _lost(found, kept),
            digest,
            lambda share: progress(_WRITTEN * share, f"writing {output.name}"),
        )
        if not kept.messages:
            raise UnreadableLogError(
                f"{path} holds no whole message: it was cut before its first second was on the disk. Nothing can be"
                " recovered from it; record again."
            )
        progress(_WRITTEN, f"reading {output.name} back")
        known, trouble = _samples(part, output)
    with contextlib.suppress(OSError):  # the log is whole without it
        checksum_file.write(output, kept.sha256, mode)
        added_notes.copy(path, output)
    progress(1.0, "done")
    return _document(found, output, kept, known, trouble, digest)


def _refuse(path: Path, output: Path) -> None:
    if output.is_dir():
        raise InputError(f"{output} is a folder: name the file to make")
    if path.exists() and output.exists() and output.samefile(path):
        raise InputError(f"{output} is the log itself: the rebuilt log goes into a file of its own")
    with reader.opened(path) as stream:
        if file_lock.is_held(stream):
            raise InputError(f"{path} is being written: `imutui stop` finishes it, and then it needs no recovery")


def _samples(path: Path, output: Path) -> tuple[Outline | None, str]:
    """What a replay finds in the rebuilt file, or None and why it can't."""
    try:
        known = pieces.outline(path, pieces.ROWS)
    except InputError as error:
        return None, str(error).replace(str(path), str(output))
    return known, f"a replay stops at {known.seconds:.3f} s: {known.log.damage}" if known.log.damage else ""


def _document(
    found: Scan, output: Path, kept: RebuiltContent, known: Outline | None, trouble: str, digest: str
) -> RecoverDocument:
    lost = _lost(found, kept)
    told = f"It can't be replayed: {trouble}" if known is None else f"It can be replayed in part: {trouble}."
    return {
        "version": VERSION,
        "log": str(found.path.resolve()),
        "output": str(output.resolve()),
        "state": state_of(found),
        "messages": kept.messages,
        "samples": 0 if known is None else known.samples,
        "duration_s": 0.0 if known is None else known.seconds,
        "topics": kept.topics,
        "chunks": kept.chunks,
        "metadata": kept.metadata,
        "attachments": kept.attachments,
        "damages": _damages(found),
        "lost": {"messages": _missing(found, kept, None), "samples": _missing(found, kept, schemas.IMU)},
        "complete": not lost and not trouble,
        "readable": known is not None,
        "sentences": [*_ending(found), *lost, *([told] if trouble else [])],
        "log_sha256": digest,
        "output_sha256": kept.sha256,
    }


def _damages(found: Scan) -> list[DamageField]:
    return [
        {"offset": d.offset, "bytes": d.bytes, "what": d.what, "why": d.why,
         "after_s": since(d.after_ns, found.first_ns), "before_s": since(d.before_ns, found.first_ns)}
        for d in found.damages
    ]  # fmt: skip


def _missing(found: Scan, kept: RebuiltContent, topic: str | None) -> int | None:
    """Messages that are not there any more, of one topic or of all; None if nothing tells how many there were."""
    have = kept.messages if topic is None else kept.topics.get(topic, 0)
    index = found.index
    if index is not None and index.statistics is not None:
        counts = index.statistics.channel_message_counts
        wanted = [n for n, channel in index.channels.items() if topic is None or channel.topic == topic]
        return max(0, sum(counts.get(number, 0) for number in wanted) - have)
    if METADATA not in kept.metadata:
        return None
    return sum(kept.missing.values()) if topic is None else kept.missing.get(topic, 0)


def _ending(found: Scan) -> list[str]:
    """How an unfinished file ended."""
    if not found.end.cut:
        return []
    cut = cut_end(found)
    if cut is None:
        return ["It ended without its index; every record in it is whole."]
    if cut.what == "summary":
        return ["Its index was cut or damaged and is made anew; every message is whole."]
    return [f"It ended in the middle: its last {plural(cut.bytes, 'byte')} are no whole record."]


def _lost(found: Scan, kept: RebuiltContent) -> list[str]:
    """What is not in the rebuilt file, a sentence each; empty if nothing is missing but an unfinished end."""
    costly = lossy(found)
    told = [f"{place(d, found.first_ns)}: {d.why}." for d in costly[:_SHOWN]]
    told += [f"And {len(costly) - _SHOWN} more such places."] if len(costly) > _SHOWN else []
    messages, samples = _missing(found, kept, None), _missing(found, kept, schemas.IMU)
    if messages:
        counted = found.index is not None and found.index.statistics is not None
        sure = "" if counted else "By their numbers at least "
        told.append(f"{sure}{plural(messages, 'message')} are lost, {plural(samples or 0, 'sample')} among them.")
    if kept.homeless:
        told.append(f"{plural(kept.homeless, 'message')} were left out: nothing says any more what they are.")
    if kept.assumed:
        told.append(
            "The list of topics was lost with the first chunk; imutui's own, which the messages fit, stands there."
        )
    if found.repeated:
        told.append(f"{plural(found.repeated, 'chunk')} stood there twice and were taken once.")
    if found.end.trailing:
        told.append(f"{plural(found.end.trailing, 'byte')} behind the end of the log were left out.")
    if found.end.checksum_wrong:
        told.append(
            "The checksum over all data is wrong though each chunk's is right: metadata or an attachment differs."
        )
    if METADATA not in kept.metadata and set(kept.topics) & {schemas.RAW, schemas.ESTIMATE}:
        told.append("The session's metadata is lost: signs, mounting and site are unknown; it reads as a foreign log.")
    return told
