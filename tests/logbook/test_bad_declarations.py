"""Logs that declare more than a file can have."""

from pathlib import Path

from helpers.commands import imutui
from mcap.data_stream import RecordBuilder
from mcap.records import Channel, DataEnd, Footer, Header, Schema

MAGIC = b"\x89MCAP0\r\n"


def test_more_channels_than_a_file_can_have_are_refused(home: Path) -> None:
    records = RecordBuilder()
    records.write(MAGIC)
    Header("ros2", "another program").write(records)
    Schema(id=1, data=b"", encoding="ros2msg", name="sensor_msgs/msg/Imu").write(records)
    for number in range(2**16):
        Channel(id=1 + number % 7, topic=f"/t{number}", message_encoding="cdr", metadata={}, schema_id=1).write(records)
    DataEnd(0).write(records)
    Footer(0, 0, 0).write(records)
    records.write(MAGIC)
    (home / "many.mcap").write_bytes(records.end())
    done = imutui("recover", "many.mcap", "-o", "new.mcap", check=3)
    assert "more than 65,535 channels" in done.stderr
    assert [path.name for path in home.glob("*.mcap*")] == ["many.mcap"]
