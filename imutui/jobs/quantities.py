"""Counts in sentences."""


def plural(n: int, word: str) -> str:
    """A number with its word: 1 sample, 2,000 samples."""
    return f"{n:,} {word}" if n == 1 else f"{n:,} {word}s"
