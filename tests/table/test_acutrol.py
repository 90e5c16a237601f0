"""Acutrol's dialect as bytes: lines of a host, and answers of a controller."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from filters.simulation import TableModel, TurnTable
from imutui.table.acutrol import answers, number
from imutui.table.acutrol_virtual import VirtualAcutrol
from imutui.table.server import LONGEST_LINE, Lines

STREAM = b":interlock:open 1\r\n:demand:position 1, 09.974\r\n*idn?\n\n:read:pos? 1;rate? 1\n"
LINES = [":interlock:open 1", ":demand:position 1, 09.974", "*idn?", ":read:pos? 1;rate? 1"]


def test_lines_are_the_same_byte_by_byte_and_cut_anywhere() -> None:
    assert Lines().feed(STREAM) == LINES
    lines = Lines()
    assert [line for byte in STREAM for line in lines.feed(bytes([byte]))] == LINES
    for cut in range(len(STREAM)):
        lines = Lines()
        assert lines.feed(STREAM[:cut]) + lines.feed(STREAM[cut:]) == LINES


@given(st.binary(max_size=200).filter(lambda data: b"\n" not in data))
def test_garbage_costs_its_own_line(garbage: bytes) -> None:
    *_, last = lines = Lines().feed(garbage + b"\n:mode? 1\r\n")
    assert last == ":mode? 1"
    controller = VirtualAcutrol(TurnTable(TableModel()))
    assert controller.carry_out(last, 0.0) == [(True, "Off")]
    for line in lines:
        assert len(controller.carry_out(line, 0.0)) == line.count(";") + 1


def test_a_line_without_an_end_is_given_up() -> None:
    lines = Lines()
    lines.feed(b"x" * (LONGEST_LINE + 1))
    assert lines.feed(b"\n:mode? 1\n") == [":mode? 1"]


@pytest.mark.parametrize("line", [":read:pos? 1;:mode? 1", ":read:pos? 1;mode? 1"])
def test_a_later_command_may_leave_the_branch_with_a_colon_or_by_a_word_that_is_not_in_it(line: str) -> None:
    assert VirtualAcutrol(TurnTable(TableModel())).carry_out(line, 0.0)[1] == (True, "Off")


@pytest.mark.parametrize("prefix", [b"", b"00000000", b"0012   :", b"\n\r\x00\xff1234"])
@pytest.mark.parametrize("end", [b"\n", b"\r\n"])
@pytest.mark.parametrize("texts", [("12.3", "0.0", "0.0"), ("OK",), ("400,500,20000,0,0,440",)])
def test_an_answer_ends_with_its_line_whatever_its_prefix(prefix: bytes, end: bytes, texts: tuple[str, ...]) -> None:
    line = prefix + ";".join(texts).encode() + end
    assert answers(line, len(prefix)) == (texts, True)
    assert answers(line.removesuffix(end), len(prefix)) == (texts, False)
    for cut in range(len(prefix) + 1):
        assert answers(line[:cut], len(prefix)) == ((), False)


@given(st.floats(-1e6, 1e6))
def test_numbers_have_no_exponent_and_are_read_back(value: float) -> None:
    text = number(value)
    assert "e" not in text
    assert abs(float(text) - value) <= 0.51e-5
