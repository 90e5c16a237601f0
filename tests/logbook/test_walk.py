"""One walk over a log: damage is an item, and a walk without marks ends with it."""

from pathlib import Path

import pytest
from helpers.logs import recorded
from mcap.writer import CompressionType, Writer

from imutui.logbook.mcap_stream import Batch
from imutui.logbook.scan import scan
from imutui.logbook.walk import ChunkHead, Damage, End, Item, follow, walk


def test_a_walk_without_marks_ends_with_the_first_damage_and_one_with_marks_goes_on(tmp_path: Path) -> None:
    path = recorded(tmp_path / "a.mcap", 4)
    whole = scan(path)
    data = bytearray(path.read_bytes())
    at = len(data) // 2
    data[at : at + 40] = bytes(byte ^ 0x55 for byte in data[at : at + 40])
    path.write_bytes(data)
    with path.open("rb") as stream:
        items = list(walk(stream))
    before = [item for item in items if isinstance(item, ChunkHead)]
    assert isinstance(items[-2], Damage)
    assert isinstance(items[-1], End)
    spoilt = scan(path)
    assert len(spoilt.damages) == 1
    assert 0 < len(before) < spoilt.chunks < whole.chunks
    assert spoilt.end.finished


def test_a_chunk_of_more_than_64_mib_is_read(tmp_path: Path) -> None:
    path = tmp_path / "large.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.NONE)
        writer.start()
        channel = writer.register_channel("/camera", "cdr", 0)
        writer.add_message(channel, 1, bytes(65 * 2**20), 1)
        writer.finish()
    with path.open("rb") as stream:
        items = list(walk(stream))
    assert sum(len(item.table) for item in items if isinstance(item, Batch)) == 1
    assert isinstance(items[-1], End)
    assert items[-1].finished


def times(items: list[Item]) -> list[int]:
    return [int(at) for item in items if isinstance(item, Batch) for at in item.heads["log_ns"]]


@pytest.mark.parametrize("piece", [1, 777, 20_000])
def test_a_log_that_grows_by_pieces_of_any_size_is_followed_to_its_end(tmp_path: Path, piece: int) -> None:
    data = recorded(tmp_path / "a.mcap", 2).read_bytes()
    path, items = tmp_path / "growing.mcap", list[Item]()
    cuts = range(piece, len(data), piece) if piece > 1 else [*range(1, 60), *range(len(data) - 60, len(data))]
    path.touch()
    with path.open("ab", buffering=0) as out, path.open("rb") as stream:
        following, written = follow(stream), 0
        for end in [*cuts, len(data)]:
            out.write(data[written:end])
            written = end
            for item in following:
                items.append(item)
                if isinstance(item, End):
                    break
    with (tmp_path / "a.mcap").open("rb") as stream:
        assert times(items) == times(list(walk(stream)))
    ends = [item for item in items if isinstance(item, End)]
    assert [end.finished for end in ends] == [False] * (len(ends) - 1) + [True]
    assert not ends[-1].checksum_wrong
