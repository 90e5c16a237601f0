"""Names of a port that lead to the same adapter again, and lines that must not be opened."""

import os
from pathlib import Path

import pytest

from imutui.instrument import port
from imutui.instrument.port import Port, PortError


@pytest.fixture
def device() -> str:
    """A pseudo-terminal that is nobody's terminal."""
    _, slave = os.openpty()
    return os.ttyname(slave)


def test_a_bare_path_is_remembered_by_the_name_of_its_adapter(
    device: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(port, "_BY_ID", tmp_path)
    assert port.lasting_name(device) == device
    link = tmp_path / "usb-FTDI_cable_A1-if00-port0"
    link.symlink_to(device)
    assert port.lasting_name(device) == str(link)
    assert port.lasting_name(link.name) == str(link)
    (tmp_path / "mine").symlink_to(device)
    assert port.lasting_name(str(tmp_path / "mine")) == str(tmp_path / "mine")
    assert port.lasting_name("socket://10.0.0.1:4001") == "socket://10.0.0.1:4001"


def test_a_line_is_opened_again_where_its_adapter_is_now(
    device: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not at its old path, which may be another adapter's by then; what is not there is said."""
    monkeypatch.setattr(port, "_BY_ID", tmp_path)
    link = tmp_path / "usb-FTDI_cable_A1-if00-port0"
    link.symlink_to(device)
    with Port(device, 38400) as line:
        assert not line.has_moved()
        link.unlink()
        line.close()
        with pytest.raises(PortError, match="is not there"):
            line.reopen(38400)
        master, slave = os.openpty()
        link.symlink_to(os.ttyname(slave))
        line.reopen(38400)
        line.write(b"P")
        assert os.read(master, 1) == b"P"


def test_a_pseudo_terminal_named_by_its_number_is_not_opened_again(device: str) -> None:
    """The next virtual instrument may have that number, and the same serial number."""
    with Port(device, 38400) as line, pytest.raises(PortError, match="soon another's"):
        line.reopen(38400)
