"""Counts and times in sentences."""

from datetime import UTC, datetime


def plural(n: int, word: str) -> str:
    """A number with its word: 1 sample, 2,000 samples."""
    return f"{n:,} {word}" if n == 1 else f"{n:,} {word}s"


def that_many(n: int, word: str, one: str, many: str) -> str:
    """A number with its word and a verb that agrees with it: 1 packet was, 2 packets were."""
    return f"{plural(n, word)} {one if n == 1 else many}"


def utc_text(ns: int) -> str:
    """A time in UTC, ns, with milliseconds: 2026-03-01T09:30:00.000Z."""
    try:
        return datetime.fromtimestamp(ns / 1e9, UTC).strftime("%Y-%m-%dT%H:%M:%S.") + f"{ns // 1_000_000 % 1000:03d}Z"
    except (OverflowError, ValueError, OSError):
        return "no time"
