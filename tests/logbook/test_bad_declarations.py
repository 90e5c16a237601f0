"""Logs that declare what no file can have, or what no message can be."""

from pathlib import Path

import pytest
from helpers.commands import imutui
from mcap.data_stream import RecordBuilder
from mcap.records import Channel, DataEnd, Footer, Header, Schema
from mcap.writer import Writer

MAGIC = b"\x89MCAP0\r\n"
DEFINITIONS = {
    "no type": b"int32 [ x\n",
    "endless array": b"float64[999999999999999999999] x\n",
    "of itself": b"my_msgs/Thing x\n",
    "of nothing": b"foo_msgs/Bar x\n",
    "no text": b"\xff\xfe",
    "twice": b"int32 x\nint32 x\n",
}


@pytest.mark.parametrize("kind", DEFINITIONS)
def test_a_bad_definition_is_an_error_in_words(home: Path, kind: str) -> None:
    with (home / "bad.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start("ros2", "another program")
        schema = writer.register_schema("my_msgs/msg/Thing", "ros2msg", DEFINITIONS[kind])
        channel = writer.register_channel("/thing", "cdr", schema)
        writer.add_message(channel, 1, b"\0\1\0\0abcd", 1)
        writer.finish()
    done = imutui("export", "bad.mcap", "--topic", "/thing", "--format", "csv", "-o", "o.csv", check=3)
    assert done.stderr.startswith("imutui: bad.mcap: ")
    assert len(done.stderr.splitlines()) == 1


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
