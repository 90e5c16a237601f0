"""Counts in sentences."""


def plural(n: int, word: str) -> str:
    """A number with its word: 1 sample, 2,000 samples."""
    return f"{n:,} {word}" if n == 1 else f"{n:,} {word}s"


def that_many(n: int, word: str, one: str, many: str) -> str:
    """A number with its word and a verb that agrees with it: 1 packet was, 2 packets were."""
    return f"{plural(n, word)} {one if n == 1 else many}"
