"""Addresses of controllers, links that are there or not, and answers that are none."""

import contextlib
import select
import socket
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from filters.errors import InputError
from filters.simulation import TableModel, TurnTable
from imutui.instrument.pseudo_terminal import PseudoTerminal
from imutui.table.acutrol import connect
from imutui.table.acutrol_virtual import VirtualAcutrol
from imutui.table.links import TableError, TableLinkError
from imutui.table.motion import MODES, AxisLimits, Move
from imutui.table.server import BUS, Lines, TableServer, encode_answer

# ---------------------------------------------------------------------------------------- what no controller says well


@contextmanager
def saying(*answers: bytes) -> Iterator[str]:
    """URL of something on TCP that answers so to each line in turn, whatever it is, and then hangs up."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        open_ones: list[socket.socket] = []

        def serve() -> None:
            connection, _ = listener.accept()
            open_ones.append(connection)
            for answer in answers:
                if not connection.recv(4096):
                    break
                for byte in answer:  # as slowly as it may come
                    connection.sendall(bytes([byte]))
            connection.close()

        threading.Thread(target=serve, daemon=True).start()
        try:
            yield f"acutrol://127.0.0.1:{listener.getsockname()[1]}?axes=inner"
        finally:
            for connection in open_ones:
                with contextlib.suppress(OSError):  # the host has gone already
                    connection.shutdown(socket.SHUT_RDWR)


LIMITS = b"00000000400,500,20000,0,0,440\n"


@pytest.mark.parametrize(
    ("answer", "why"),
    [
        (b"00000000nothing\n", "nothing"),
        (b"00000000\n", 'answers ""'),
        (b"00000000nan,1,1,1,1,1\n", "nan"),
        (b"00000000400,500\n", "400,500"),
        (b"00000000400,500,20000,0,0,440;7\n", "7"),
        (b"000000000,0,0,0,0,0\n", "axes=inner"),
        (b"\xff" * 8 + b"\xfe\xff\n", "docs/tables.md"),
    ],
)
def test_an_answer_that_is_none_is_told_as_it_stands(answer: bytes, why: str) -> None:
    with saying(answer, answer) as url, pytest.raises(TableError, match=why) as error:
        connect(url).limits()
    assert "\n" not in str(error.value)


def test_an_answer_may_come_byte_by_byte() -> None:
    with saying(LIMITS, b"00000000359.5;-0.25\n") as url:
        controller = connect(url)
        assert controller.limits()["inner"] == AxisLimits(400.0, 500.0, None, None)


def test_a_mode_that_nobody_has_seen_is_taken_for_the_most_active() -> None:
    with saying(b"00000000Tracking;Closed\n", b"000000001.0;2.0\n") as url:
        assert connect(url).read().mode == MODES[-1]


def test_it_is_stopped_whatever_it_says_of_its_modes() -> None:
    """Rate zero, rate mode and mode off are sent; that it rests with its modes off is not taken for granted."""

    class Odd(VirtualAcutrol):
        def carry_out(self, line: str, now: float) -> list[tuple[bool, str]]:
            said = super().carry_out(line, now)
            return [(True, "not known")] * len(said) if line.startswith(":mode?") else said

    told: list[str] = []
    controller = Odd(TurnTable(TableModel(axes=("inner",))))
    with TableServer(controller, ("127.0.0.1", 0), time.monotonic, log=told.append) as server:
        host = connect(f"acutrol://127.0.0.1:{server.port}?axes=inner")
        with pytest.raises(TableError, match="not known"):
            host.stop()
    assert [line for line in told if "interlock" not in line][:3] == [
        ":demand:rate 1,0",
        ":mode:rate 1",
        ":mode:rate 1",
    ]
    assert told[-1] == ":mode:off 1"


def test_a_host_that_hangs_up_is_a_lost_link() -> None:
    with saying(LIMITS) as url:
        controller = connect(url)
        controller.limits()
        with pytest.raises(TableLinkError):
            controller.read()


# ----------------------------------------------------------------------------------------------------------- addresses


@pytest.mark.parametrize(
    ("url", "why"),
    [
        ("", "it is one of"),
        ("acutrol", "it is one of"),
        ("telnet://host:1", "it is one of"),
        ("acutrol://", "no HOST:PORT"),
        ("acutrol://host:port", "no HOST:PORT"),
        ("acutrol://host:70000", "no HOST:PORT"),
        ("acutrol://host:1?axis=inner", 'an option "axis"'),
        ("acutrol://host:1?axes=inner,inner", "each once"),
        ("acutrol://host:1?axes=up", "not some of"),
        ("acutrol+serial:tty?baud=fast", "no line speed"),
    ],
)
def test_an_address_that_is_none_is_refused_in_words(url: str, why: str) -> None:
    with pytest.raises(InputError, match=why):
        connect(url)


def test_a_controller_that_is_not_there_is_told_with_its_address() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
    with pytest.raises(TableLinkError, match=f"can't be reached.*{port}"):
        connect(f"acutrol://127.0.0.1:{port}")
    with pytest.raises(TableLinkError, match="no such port"):
        connect("acutrol+serial:/dev/nothing-there")


def test_gpib_needs_a_library_and_says_which(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyvisa", None)  # an import of it fails, as where it is not installed
    with pytest.raises(InputError, match="gpib"):
        connect("acutrol+gpib:GPIB0::1::INSTR")


def test_a_serial_line_is_a_terminals(tmp_path: Path) -> None:
    """The same dialogue over a device, where nothing says that a peer is there."""
    controller, closing = VirtualAcutrol(TurnTable(TableModel(axes=("inner",)))), threading.Event()
    with PseudoTerminal(tmp_path / "line") as pty:

        def serve() -> None:
            lines = Lines()
            while not closing.is_set():
                pty.release()
                if not select.select([pty], (), (), 0.02)[0]:
                    continue
                for line in lines.feed(pty.read()):
                    pty.write(encode_answer(controller.carry_out(line, 0.0), BUS))

        thread = threading.Thread(target=serve)
        thread.start()
        try:
            host = connect(f"acutrol+serial:{tmp_path / 'line'}?baud=19200")
            assert host.axes == ("inner",)
            host.enable()
            host.start(Move("inner", 30.0, 50.0, 100.0))
            state = host.read()
            assert state.mode == "position"
            assert state.fault == ""
            host.close()
        finally:
            closing.set()
            thread.join()


BUS_DEVICE = """
spec: "1.1"
devices:
  table:
    eom: {GPIB INSTR: {q: "\\r\\n", r: "\\n"}}
    delimiter: "|"
    error: ERROR
    dialogues:
      - {q: "*idn?", r: "SIM TABLE"}
      - {q: ":limit:absolute? 1", r: "400,500,20000,0,0,440"}
      - {q: ":read:position? 1", r: "12.5"}
      - {q: ":read:position? 1;rate? 1", r: "12.5;0.0"}
      - {q: ":mode? 1;interlock? 1", r: "Off;Open"}
      - {q: ":read:rate? 1", r: "0.0"}
      - {q: ":demand:rate 1,0"}
      - {q: ":mode:rate 1"}
      - {q: ":mode:off 1"}
resources:
  GPIB0::1::INSTR: {device: table}
"""


def test_a_bus_is_spoken_to_by_pyvisa(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """On pyvisa's own simulated bus. Skipped without the libraries of the extra `test`."""
    pytest.importorskip("pyvisa_sim")
    (tmp_path / "bus.yaml").write_text(BUS_DEVICE)
    monkeypatch.setenv("PYVISA_LIBRARY", f"{tmp_path / 'bus.yaml'}@sim")
    controller = connect("acutrol+gpib:GPIB0::1::INSTR")
    assert controller.axes == ("inner",)
    assert controller.identify() == "SIM TABLE"
    assert controller.limits() == {"inner": AxisLimits(400.0, 500.0, None, None)}
    state = controller.read()
    assert state.angles_deg == (0.0, 0.0, 12.5)
    assert (state.mode, state.fault) == ("off", "")
    controller.stop()
    controller.close()
    with pytest.raises(TableLinkError, match="GPIB0::9::INSTR"):
        connect("acutrol+gpib:GPIB0::9::INSTR")
