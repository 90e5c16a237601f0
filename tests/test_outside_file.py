"""Files from outside: pipes of shells are read, pipes that would never end are refused."""

import os
import threading
from pathlib import Path

import pytest

from filters.errors import InputError
from imutui import outside_file


def test_a_pipe_of_a_shell_is_read_to_its_end() -> None:
    """`--effects <(...)`: its writer holds it open before it writes."""
    ours, theirs = os.pipe()

    def write() -> None:
        with open(theirs, "wb") as stream:
            stream.write(b"version")
            stream.flush()
            stream.write(b" = 1")

    writer = threading.Thread(target=write)
    try:
        writer.start()
        assert outside_file.read(Path(f"/proc/self/fd/{ours}"), 100) == b"version = 1"
    finally:
        writer.join()
        os.close(ours)


def test_a_pipe_without_a_writer_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(InputError, match="no process writes into"):
        outside_file.read(tmp_path / "pipe", 100)
    with pytest.raises(OSError, match="is a pipe, not a file"):
        outside_file.opened(tmp_path / "pipe")


def test_a_device_is_no_file() -> None:
    with pytest.raises(OSError, match="is a device, not a file"):
        outside_file.opened(Path("/dev/zero"))


@pytest.mark.parametrize(("place", "can"), [("new/folder", True), ("file/folder", False), ("file", False)])
def test_a_folder_can_be_written_if_it_can_be_made(tmp_path: Path, place: str, can: bool) -> None:
    (tmp_path / "file").touch()
    assert outside_file.can_be_written(tmp_path / place) is can
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file"]


def test_not_even_root_can_write_among_the_kernels_own_files() -> None:
    assert not outside_file.can_be_written("/proc/nowhere/imutui")
