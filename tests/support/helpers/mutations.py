"""Inputs that nobody thought of, made of ones that are right: bytes, texts, and logs whose checksums fit all the same.

Everything is drawn from the generator that is given, so that a seed is an input.
"""

import contextlib
import random
import re
import struct
import zlib
from collections.abc import Callable

import lz4.frame
import zstandard
from mcap.exceptions import McapError
from mcap.records import Chunk

from imutui.logbook.mcap_format import FOOTER, HEAD, MAGIC, parse, records

WORDS = (
    "nan", "inf", "-inf", "1e400", "-1e400", "1e308", "1e-320", "9" * 400, "-" + "9" * 20, "18446744073709551615",
    "9223372036854775808", "-1", "0", "-0.0", "1e-9", "1e18", "", " ", "true", "null", '"x"', "[]", "{}", "[[1.0]]",
    "\x00", "\x1b[2J", "\u202e", "é", "none", "x,y,z", "turned", "gravity", "trajectory", "profile", "log",
    "/", "..", "a.b.c", "1.5", "1e10", "0.1", "[1, 2, 3]", "[0.0, 0.0, 0.0]", "[" * 60, "{a = " * 40,
)  # fmt: skip
"""What is put in a word's place."""
SIZES = (0, 1, 7, 2**15, 2**16 - 1, 2**31 - 1, 2**31, 2**32 - 1, 2**63 - 1, 2**63, 2**64 - 1, 2**28, 2**26, 2**62)
"""What is put in a number's place."""
DOUBLES = (float("nan"), float("inf"), float("-inf"), 1e308, -1e308, 5e-324, 0.0, -0.0, 1e18, -1.0)
_CHUNK, _MESSAGE, _METADATA, _ATTACHMENT, _DATA_END, _FOOTER = 6, 5, 12, 9, 15, 2
_MOST = 2**20


def spoilt_bytes(rng: random.Random, data: bytes) -> bytes:
    """Bytes with a few places changed, left out, doubled, cut off or filled with something else."""
    made = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 3, 8))):
        at = rng.randrange(len(made) + 1)
        size = rng.choice((1, 1, 2, 4, 8, 30, 300))
        match rng.randrange(7):
            case 0 if made:
                made[at % len(made)] ^= 1 << rng.randrange(8)
            case 1 if made:
                made[at % len(made)] = rng.choice((0, 1, 0x7F, 0x80, 0xFF))
            case 2:
                del made[at : at + size]
            case 3:
                made[at:at] = rng.randbytes(size)
            case 4:
                made[at:at] = made[at : at + size]
            case 5:
                width, pattern = rng.choice(((2, "<H"), (4, "<I"), (8, "<Q")))
                made[at : at + width] = struct.pack(pattern, rng.choice(SIZES) % 256**width)
            case _ if rng.random() < 0.2:
                del made[at:]
    return bytes(made[:_MOST])


def spoilt_text(rng: random.Random, data: bytes) -> bytes:
    """Text with words changed, lines left out, doubled or moved, nesting, or as `spoilt_bytes` spoils it."""
    if rng.random() < 0.15:
        return spoilt_bytes(rng, data)
    text = data.decode(errors="replace")
    for _ in range(rng.choice((1, 1, 2, 4))):
        lines = text.split("\n")
        at = rng.randrange(len(lines))
        match rng.randrange(8):
            case 0 | 1 | 2 | 3:
                text = _word_changed(rng, text)
                continue
            case 4:
                del lines[at]
            case 5:
                lines[at:at] = lines[at : at + rng.choice((1, 3, 20))] * rng.choice((1, 2, 50))
            case 6:
                lines.insert(rng.randrange(len(lines) + 1), lines.pop(at))
            case _:
                lines[at] += rng.choice(("[" * 3000, "{x=" * 2000, '"""', "'", "\x00", ".a" * 3000, ",,,,", "#"))
        text = "\n".join(lines)
    return text.encode(errors="replace")[:_MOST]


def _word_changed(rng: random.Random, text: str) -> str:
    words = list(re.finditer(r"[^\s,\[\]{}=\"]+", text))
    if not words:
        return rng.choice(WORDS)
    word = rng.choice(words)
    other = rng.choice((*WORDS, rng.choice(words)[0], rng.choice(words)[0]))
    return text[: word.start()] + other + text[word.end() :]


# ---------------------------------------------------------------------------------------------------------------- logs

Part = tuple[int, bytes]  # opcode and content of a record


def spoilt_log(rng: random.Random, data: bytes) -> bytes:
    """A log spoilt in what it says, or in its bytes."""
    how = rng.random()
    if how < 0.25:
        return spoilt_bytes(rng, data)
    parts = [(opcode, data[at : at + n]) for opcode, at, n in _records_of(data)]
    parts = [_opened(part) for part in parts]
    for _ in range(rng.choice((1, 1, 2, 5))):
        _spoil_records(rng, parts)
    made = _written(rng, parts)
    return spoilt_bytes(rng, made) if how > 0.93 else made


def _records_of(data: bytes) -> list[tuple[int, int, int]]:
    found: list[tuple[int, int, int]] = []
    with contextlib.suppress(McapError):  # of a file that was cut, what is whole
        for opcode, at, n in records(data[len(MAGIC) :]):
            found.append((opcode, at + len(MAGIC), n))
            if opcode == _FOOTER:
                break
    return found


def _opened(part: Part) -> Part | list[Part]:
    """A chunk as the records in it."""
    if part[0] != _CHUNK:
        return part
    inside = zstandard.decompress(parse(Chunk, part[1]).data)
    return [(opcode, inside[at : at + n]) for opcode, at, n in records(inside)]


def _spoil_records(rng: random.Random, parts: "list[Part | list[Part]]") -> None:
    inside = [part for part in parts if isinstance(part, list) and part]
    where = rng.choice(inside) if inside and rng.random() < 0.6 else parts
    if not where:
        return
    at = rng.randrange(len(where))
    match rng.randrange(8):
        case 0:
            del where[at]
        case 1:
            where[at:at] = where[at : at + rng.choice((1, 2, 9))]
        case 2:
            where.insert(rng.randrange(len(where)), where.pop(at))
        case 3:
            where.insert(at, (rng.choice((*range(17), 0x80, 0xFF)), rng.randbytes(rng.choice((0, 4, 22, 60)))))  # type: ignore[arg-type]
        case _:
            part = where[at]
            if isinstance(part, tuple):
                where[at] = _spoilt_record(rng, part)


def _spoilt_record(rng: random.Random, part: Part) -> Part:
    opcode, content = part
    if opcode == _METADATA:
        return opcode, _spoilt_metadata(rng, content)
    made = bytearray(content)
    if opcode == _MESSAGE and rng.random() < 0.6 and len(made) > 40:
        # log and publish time, or a number of the message's own
        at = rng.choice((6, 14, 22 + 4, 22 + 8, 22 + 12, *range(40, len(made) - 8, 8)))
        value = struct.pack("<d", rng.choice(DOUBLES)) if at >= 40 else struct.pack("<Q", rng.choice(SIZES))
        made[at : at + 8] = value
        return opcode, bytes(made)
    if opcode == _ATTACHMENT:
        # behind the two times and the length of the name; the checksum is made anew
        inside = spoilt_text(rng, bytes(made[16:-4])) if rng.random() < 0.6 else spoilt_bytes(rng, bytes(made[16:-4]))
        body = bytes(made[:16]) + inside
        return opcode, body + struct.pack("<I", zlib.crc32(body))
    return opcode, spoilt_bytes(rng, content)


def _spoilt_metadata(rng: random.Random, content: bytes) -> bytes:
    """One value of a metadata record replaced, its length with it."""
    try:
        (size,) = struct.unpack_from("<I", content)
        name, at, pairs = content[4 : 4 + size], 8 + size, []
        while at < len(content):
            key, at = _prefixed(content, at)
            value, at = _prefixed(content, at)
            pairs.append([key, value])
    except struct.error:
        return spoilt_bytes(rng, content)
    if pairs:
        chosen = rng.choice(pairs)
        chosen[1] = rng.choice((rng.choice(WORDS).encode(), rng.choice(WORDS).encode(), rng.choice(pairs)[1]))
    body = b"".join(struct.pack("<I", len(text)) + text for pair in pairs for text in pair)
    return struct.pack("<I", len(name)) + name + struct.pack("<I", len(body)) + body


def _prefixed(content: bytes, at: int) -> tuple[bytes, int]:
    (size,) = struct.unpack_from("<I", content, at)
    return content[at + 4 : at + 4 + size], at + 4 + size


_PACKED: dict[str, Callable[[bytes], bytes]] = {"zstd": zstandard.compress, "lz4": lz4.frame.compress, "": bytes}


def _written(rng: random.Random, parts: "list[Part | list[Part]]") -> bytes:
    """Records as a file: chunks packed with the right checksums, the index as it was, its places wrong or not."""
    out = bytearray(MAGIC)
    compression = rng.choice(("zstd", "zstd", "lz4", ""))
    for part in parts:
        opcode, content = (_CHUNK, _chunk(rng, part, compression)) if isinstance(part, list) else part
        if opcode == _DATA_END and rng.random() < 0.7:
            content = bytes(4)
        if opcode == _FOOTER and len(content) == 20 and rng.random() < 0.8:
            # where the summary begins: just behind the end of the data
            start = _summary_start(out)
            head = FOOTER.pack(_FOOTER, 20, start, 0, 0)[:-4]
            content = struct.pack("<QQI", start, 0, zlib.crc32(head, zlib.crc32(out[start:])) if start else 0)
        out += HEAD.pack(opcode, len(content)) + content
    return bytes(out + MAGIC) if rng.random() < 0.9 else bytes(out)


def _summary_start(out: bytearray) -> int:
    found = out.rfind(HEAD.pack(_DATA_END, 4))
    return found + HEAD.size + 4 if found > 0 else 0


def _chunk(rng: random.Random, part: list[Part], compression: str) -> bytes:
    inside = b"".join(HEAD.pack(opcode, len(content)) + content for opcode, content in part)
    packed = _PACKED[compression](inside)
    if rng.random() < 0.05:
        packed = spoilt_bytes(rng, packed)
    size = len(inside) if rng.random() < 0.95 else rng.choice(SIZES)
    name = compression.encode() if rng.random() < 0.98 else rng.choice((b"", b"zstd", b"lz4", b"brotli", b"\xff"))
    first, last = (rng.choice(SIZES) if rng.random() < 0.03 else 1_795_257_000_000_000_000 for _ in range(2))
    checksum = zlib.crc32(inside) if rng.random() < 0.5 else 0
    head = struct.pack("<QQQII", first, last, size, checksum, len(name)) + name
    return head + struct.pack("<Q", len(packed)) + packed
