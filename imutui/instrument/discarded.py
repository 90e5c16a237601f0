"""What a decoder of any kind says of bytes that mean nothing."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Discarded:
    """Bytes dropped while looking for the next packet or reply."""

    data: bytes  # the bytes, so that a log can hold everything that was on the line
    bad_checksum: bool  # whether a packet or reply was due among them, began rightly and had a wrong sum
