"""The index of a log that is being written takes little memory, and is the one that mcap's writer makes."""

from io import BytesIO

from mcap.writer import Writer

from imutui.logbook import mcap_format


def written(*, packed: bool, chunks: int = 50) -> tuple[bytes, Writer]:
    """A file of one channel, flushed so often, and what wrote it."""
    stream = BytesIO()
    writer = Writer(stream, enable_data_crcs=True)
    assert mcap_format.keep_packed(writer) if packed else True
    writer.start()
    channel = writer.register_channel("/a", "json", writer.register_schema("a", "jsonschema", b"{}"))
    for k in range(chunks):
        writer.add_message(channel, k, b"{}", k)
        writer.flush()
    writer.finish()
    return stream.getvalue(), writer


def test_a_file_is_the_same_to_the_byte() -> None:
    assert written(packed=True)[0] == written(packed=False)[0]
    assert written(packed=True, chunks=0)[0] == written(packed=False, chunks=0)[0]


def test_nothing_is_changed_once_a_chunk_was_written() -> None:
    """Its entry would be lost."""
    _, writer = written(packed=False)
    assert not mcap_format.keep_packed(writer)
