"""The table of a batch: what is written reads back, and what is wrong with one is said by file, table and key."""

from pathlib import Path

import pytest

from imutui import batch_file
from imutui.batch_file import Batch, BatchError, Unit


def read(folder: Path, text: str) -> Batch:
    path = folder / "ten units.toml"
    path.write_text(text)
    return batch_file.read(path)


def test_what_is_written_reads_back(tmp_path: Path) -> None:
    units = (Unit("9911750", serial="9911750"), Unit("left", "/dev/ttyUSB3", "", "imu381", "x,-y,-z", "/a/left.toml"))
    batch = Batch(tmp_path / "ten units.toml", units, 20.0, "none", 'say "so"', "ana", "T1", "room 2", "/a/six.toml")
    text = batch_file.to_toml(batch, ("IMU400CD-200 at /dev/ttyUSB0", ""))
    assert "# IMU400CD-200 at /dev/ttyUSB0" in text
    assert read(tmp_path, text) == batch
    assert batch.name == "ten-units"


def test_names_and_files_that_are_not_said(tmp_path: Path) -> None:
    batch = read(tmp_path, 'profile = "six.toml"\n[[unit]]\nserial = 12\n[[unit]]\nport = "/a"\neffects = "e.toml"\n')
    assert [unit.name for unit in batch.units] == ["12", "2"]
    assert batch.profile == str(tmp_path / "six.toml")
    assert batch.units[1].effects == str(tmp_path / "e.toml")
    assert (batch.rate, batch.note) == (None, None)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "no [[unit]]"),
        ("rate = 1\n", "no [[unit]]"),
        ("unit = 3\n", "not a list of tables [[unit]]"),
        ("[[unit]]\n", "[[unit]] 1 has no `port` or `serial`"),
        ('[[unit]]\nport = "/a"\n[[unit]]\nport = "/b"\nserial = "1"\n', "[[unit]] 2 has both `port` and `serial`"),
        ('[[unit]]\nport = "/a"\n[[unit]]\nport = "/a"\n', '[[unit]] 2: `port` is "/a", as that of [[unit]] 1'),
        ('[[unit]]\nserial = "1"\n[[unit]]\nserial = 1\n', '`name` is "1", as that of [[unit]] 1'),
        ('[[unit]]\nport = "/a"\nmount = "x,x,z"\n', 'unit 1: `mount` is "x,x,z"'),
        ('[[unit]]\nport = "/a"\ninstrument = "gyro"\n', "`instrument` is 'gyro', not one of: imu400cd"),
        ('[[unit]]\nport = "/a"\nname = "a b"\n', "`name` is 'a b', not one word"),
        ('[[unit]]\nport = "/a"\nname = "../a"\n', "not one word"),
        ('[[unit]]\nport = "/a"\nspeed = 1\n', "unit 1: `speed` is unknown; known: port, serial"),
        ("[[unit]]\nport = 7\n", "`port` is 7, not a text"),
        ("[[unit]]\nserial = true\n", "`serial` is True, not a serial number"),
        ('rate = "fast"\n[[unit]]\nport = "/a"\n', "`rate` is 'fast', not a finite number"),
        ('filter = "kalman"\n[[unit]]\nport = "/a"\n', "`filter` is 'kalman', not one of: spkf,"),
        ('hurry = 1\n[[unit]]\nport = "/a"\n', "`hurry` is unknown; known: rate"),
        ("[[unit]\n", "ten units.toml: "),
    ],
)
def test_what_is_wrong_is_said_by_file_table_and_key(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(BatchError) as wrong:
        read(tmp_path, text)
    assert said in str(wrong.value)
    assert str(wrong.value).startswith(str(tmp_path / "ten units.toml"))
    assert "Nothing was started" in str(wrong.value)


def test_several_units_may_be_virtual_ones_of_their_own(tmp_path: Path) -> None:
    assert len(read(tmp_path, '[[unit]]\nport = "virtual"\n' * 3).units) == 3


def test_a_file_that_is_not_there_is_told_with_what_writes_one(tmp_path: Path) -> None:
    with pytest.raises(BatchError, match=r"none\.toml: No such file.*imutui devices --probe -o FILE"):
        batch_file.read(tmp_path / "none.toml")
