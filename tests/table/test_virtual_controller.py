"""The virtual controller: both drivers' dialogues byte by byte on its port, and what it refuses."""

import math
import re
import socket

import pytest
from helpers.processes import LIMIT_S
from helpers.tables import served

from filters.channels import DPS
from filters.errors import InputError
from filters.simulation import TableModel, TurnTable
from imutui.table.acutrol_virtual import VirtualAcutrol
from imutui.table.server import BUS, TCP, TableServer

ONE = TableModel(axes=("inner",), encoder_noise=0.0, rate_noise=0.0, encoder_offset_sd=0.0)
OK = b"00000000OK"

# what the driver under the MIT licence sends, and what it needs to be answered: eight characters, and then "OK" alone
TCP_DIALOGUE = [
    (b":utility:lockout on\r\n", OK),
    (b":interlock:open 1\r\n", OK),
    (b":interlock:reset 1\r\n", OK),
    (b":interlock:close 1\r\n", OK),
    (b":read:rate 1\r\n", b"000000000.0000"),
    (b":read:position 1\r\n", b"000000000.0000"),
    (b":mode:rate 1\r\n", OK),
    (b":demand:rate 1, 00.000\r\n", OK),
    (b":mode:position 1\r\n", OK),
    (b":demand:position 1, 00.000\r\n", OK),
    (b":mode:off 1\r\n", OK),
    (b":interlock:open 1\r\n", OK),
]

# what the other one sends over GPIB: commands are not answered, so that an answer is the next question's
BUS_DIALOGUE = [
    (b"*idn?\n", b"IMUTUI,VIRTUAL SIM TABLE,0,1 axes\n"),
    (b":limit:absolute? 1\n", b"400,500,20000,0,0,440\n"),
    (b":Interlock:Reset 1\n:mode:off 1\n:int:close 1\n:interlock? 1\n", b"Closed\n"),
    (b":mode:synt 1\n:dem:osc 1,0,0,0\n:mode? 1\n", b"Synthesis\n"),
    (b":mode:rate 1\n:dem:rate 1,0\n:mode? 1\n", b"Rate\n"),
    (b":lim:acc pos,1,300\n:lim:rate rate,1,100\n:mode? 1\n", b"Rate\n"),
    (b":mode:pos 1\n:dem:pos 1,0\n:mode? 1\n", b"Position\n"),
    (b":read:pos? 1;rate? 1\n", b"0.0000;0.0000\n"),
    (b":d:p 1,0\n:m:p 1\n:d:p? 1\n", b"0.0000\n"),
    (b":d:r 1,0\n:m:r 1\n:mode? 1\n", b"Rate\n"),
    (b":int:open 1\n:interlock? 1;:mode? 1\n", b"Open;Off\n"),
]


class Host:
    """A connection that is spoken to in bytes."""

    def __init__(self, port: int) -> None:
        self._socket = socket.create_connection(("127.0.0.1", port), LIMIT_S)

    def ask(self, data: bytes, answer_bytes: int) -> bytes:
        self._socket.sendall(data)
        heard = b""
        while len(heard) < answer_bytes:
            heard += self._socket.recv(answer_bytes - len(heard))
        return heard

    def close(self) -> None:
        self._socket.close()


@pytest.mark.parametrize(("prefix", "dialogue"), [(TCP, TCP_DIALOGUE), (BUS, BUS_DIALOGUE)], ids=["tcp", "bus"])
def test_drivers_are_answered_as_they_expect(prefix: bytes, dialogue: list[tuple[bytes, bytes]]) -> None:
    with served(ONE, prefix=prefix) as it:
        host = Host(it.server.port)
        for sent, answer in dialogue:
            assert host.ask(sent, len(answer)) == answer, sent
        host.close()


def test_a_dialogue_is_the_same_byte_by_byte() -> None:
    with served(ONE, prefix=BUS) as it:
        host = Host(it.server.port)
        for sent, answer in BUS_DIALOGUE:
            for byte in sent[:-1]:
                host.ask(bytes([byte]), 0)
            assert host.ask(sent[-1:], len(answer)) == answer, sent
        host.close()


def answered(controller: VirtualAcutrol, line: str, now: float = 0.0) -> list[str]:
    return [text for _, text in controller.carry_out(line, now)]


def ready(model: TableModel = ONE) -> VirtualAcutrol:
    controller = VirtualAcutrol(TurnTable(model))
    assert answered(controller, ":int:reset 1;close 1;:mode:off 1") == ["OK"] * 3
    return controller


@pytest.mark.parametrize(
    "line",
    [
        "nonsense", ":read:position? 2", ":read:position?", ":read:pos? 1,1", ":demand:rate 1", ":demand:rate 1,fast",
        ":demand:rate 1,nan", ":demand:rate 1,401", ":demand:osc 1,90,2,0", ":limit:acc pos,1,0",
        ":limit:rate pos,1,401", ":limit:acc off,1,10", ":mode:fast 1", ":demand:pos:now 1", ":", "?", ":read", "*rst",
        ":mode:rate 7", ":interlock? 2", ":demand:osc? 1", ":limit:rate? pos",
    ],
)  # fmt: skip
def test_what_can_not_be_done_is_answered_in_words_and_changes_nothing(line: str) -> None:
    controller = ready()
    (said,) = answered(controller, line)
    assert re.fullmatch(r"Command not recognized|Bad argument|Out of range", said)
    assert answered(controller, ":mode? 1;:demand:rate? 1;position? 1") == ["Off", "0.0000", "0.0000"]


def test_no_mode_is_entered_while_the_interlock_is_open() -> None:
    controller = VirtualAcutrol(TurnTable(ONE))
    assert answered(controller, ":mode:rate 1") == ["Interlock not closed"]
    assert answered(controller, ":mode:off 1;:mode? 1") == ["OK", "Off"]


def test_a_mode_moves_to_its_demand_as_soon_as_it_is_entered() -> None:
    controller = ready()
    assert answered(controller, ":demand:position 1,10") == ["OK"]
    assert answered(controller, ":read:pos? 1", 2.0) == ["0.0000"]
    answered(controller, ":mode:position 1", 2.0)
    assert answered(controller, ":read:pos? 1;rate? 1", 6.0) == ["10.0000", "0.0000"]


def test_limits_of_its_mode_hold_and_can_be_changed_on_the_way() -> None:
    controller = ready()
    answered(controller, ":limit:rate pos,1,20;acc pos,1,100;:demand:position 1,90;:mode:position 1")
    assert answered(controller, ":read:rate? 1", 1.0) == ["20.0000"]
    answered(controller, ":limit:rate pos,1,40", 1.0)
    assert answered(controller, ":read:rate? 1", 2.0) == ["40.0000"]
    assert math.isclose(controller.table.axes["inner"].accel_limit, 100.0 * DPS)


def test_equal_lines_at_equal_times_are_answered_alike() -> None:
    def all_of_it() -> list[list[str]]:
        controller = ready(TableModel(seed=8))
        answered(controller, ":demand:rate 3,50;:mode:rate 3")
        return [answered(controller, ":read:pos? 3;rate? 3", 0.1 * n) for n in range(40)]

    assert all_of_it() == all_of_it()


@pytest.mark.parametrize("host", ["0.0.0.0", "192.168.1.53", "example.org"])
def test_nothing_is_served_beyond_this_machine(host: str) -> None:
    with pytest.raises(InputError, match="loopback"):
        TableServer(ready(), (host, 0), lambda: 0.0)
