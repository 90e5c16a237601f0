"""What a scan found wrong with a file's bytes, in sentences: what, where, what it costs."""

from imutui.jobs.documents import DamageField
from imutui.logbook.scan import Damage, Scan

_SHOWN = 20


def at_end(found: Scan, damage: Damage) -> bool:
    """Whether damage is only that the file ends before its last record does."""
    return found.cut and damage.offset + damage.bytes >= found.size


def lossy(found: Scan) -> list[Damage]:
    """Damage that cost records: not the cut end of an unfinished file, nor what can be made anew."""
    return [d for d in found.damages if not at_end(found, d) and d.what not in ("summary", "message index")]


def documents(found: Scan, start_ns: int | None) -> list[DamageField]:
    """Damage as records of a result document; times in s since `start_ns`."""
    return [
        {
            "offset": d.offset,
            "bytes": d.bytes,
            "what": d.what,
            "why": d.why,
            "after_s": _since(d.after_ns, start_ns),
            "before_s": _since(d.before_ns, start_ns),
        }
        for d in found.damages
    ]


def sentence(damage: Damage, start_ns: int | None) -> str:
    """One place in the file, and what is wrong there."""
    return f"{place(damage, start_ns)}: {damage.why}"


def place(damage: Damage, start_ns: int | None) -> str:
    """One place in the file, in bytes and in the log's time."""
    after, before = _since(damage.after_ns, start_ns), _since(damage.before_ns, start_ns)
    if after is not None and before is not None:
        when = f", between {after:.1f} and {before:.1f} s of the log"
    elif after is not None:
        when = f", after {after:.1f} s of the log"
    elif before is not None:
        when = ", before all that can be read" if before <= 0.0 else f", before {before:.1f} s of the log"
    else:
        when = ""
    return f"{damage.bytes:,} bytes at byte {damage.offset:,}{when}"


def sentences(found: Scan, start_ns: int | None) -> list[str]:
    """Damage that cost records, a sentence each; the first of many."""
    costly = lossy(found)
    told = [f"{sentence(d, start_ns)}." for d in costly[:_SHOWN]]
    return told + ([f"And {len(costly) - _SHOWN} more such places."] if len(costly) > _SHOWN else [])


def _since(ns: int | None, start_ns: int | None) -> float | None:
    return None if ns is None or start_ns is None else (ns - start_ns) / 1e9
