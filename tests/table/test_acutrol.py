"""Acutrol's dialect as bytes: one table of cases for both directions, and what both public drivers send."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from imutui.table import acutrol
from imutui.table.acutrol import AnswerDecoder, Command, CommandDecoder, Unknown, ask, demand, interlock, limit, mode

CASES = [
    ([acutrol.IDENTIFY], b"*idn?\r\n"),
    ([demand("position", 1, 12.5)], b":demand:position 1,12.5\r\n"),
    ([demand("rate", 2, -0.000001)], b":demand:rate 2,0\r\n"),
    ([demand("oscillation", 3, 5.0, 0.25, 0.0)], b":demand:osc 3,5,0.25,0\r\n"),
    ([mode("position", 1)], b":mode:position 1\r\n"),
    ([mode("synthesis", 1)], b":mode:synt 1\r\n"),
    ([mode("off", acutrol.ALL)], b":mode:off all\r\n"),
    ([interlock("close", 1)], b":interlock:close 1\r\n"),
    ([limit("acceleration", "position", 1, 100.0)], b":limit:acc pos,1,100\r\n"),
    ([limit("rate", "synthesis", 2, 1234.5)], b":limit:rate synt,2,1234.5\r\n"),
    ([ask("limit", "absolute", axis=1)], b":limit:absolute? 1\r\n"),
    (
        [ask("read", "position", axis=1), ask("read", "rate", axis=1), ask("read", "acceleration", axis=1)],
        b":read:position? 1;rate? 1;acc? 1\r\n",
    ),
    ([ask("mode", axis=1), ask("interlock", axis=1)], b":mode? 1;interlock? 1\r\n"),
    ([ask("read", "rate", axis=1), ask("mode", axis=1)], b":read:rate? 1;:mode? 1\r\n"),
]

# what the driver under the MIT licence sends over TCP, and what ours takes it for
TCP_DRIVER = [
    (b":utility:lockout on\r\n", Command(("utility", "lockout"), ("on",))),
    (b":interlock:open 1\r\n", Command(("interlock", "open"), ("1",))),
    (b":interlock:reset 1\r\n", Command(("interlock", "reset"), ("1",))),
    (b":interlock:close 1\r\n", Command(("interlock", "close"), ("1",))),
    (b":mode:position 1\r\n", Command(("mode", "position"), ("1",))),
    (b":demand:position 1, 09.974\r\n", Command(("demand", "position"), ("1", "09.974"))),
    (b":mode:rate 1\r\n", Command(("mode", "rate"), ("1",))),
    (b":demand:rate 1, -5.730\r\n", Command(("demand", "rate"), ("1", "-5.730"))),
    (b":read:rate 1\r\n", Command(("read", "rate"), ("1",), asks=True)),
    (b":read:position 1\r\n", Command(("read", "position"), ("1",), asks=True)),
    (b":mode:off 1\r\n", Command(("mode", "off"), ("1",))),
]

# what the other one sends over GPIB; facts, its words are its own
GPIB_DRIVER = [
    (b"*idn?\n", [Command(("*idn",), (), asks=True)]),
    (b"*stb?\n", [Command(("*stb",), (), asks=True)]),
    (
        b":read:pos? 1;rate? 1;acc? 1\n",
        [Command(("read", what), ("1",), asks=True) for what in ("position", "rate", "acceleration")],
    ),
    (b":interlock? 1\n", [Command(("interlock",), ("1",), asks=True)]),
    (b":Interlock:Reset\n", [Command(("interlock", "reset"))]),
    (b":int:close 1\n", [Command(("interlock", "close"), ("1",))]),
    (b":int:open 1\n", [Command(("interlock", "open"), ("1",))]),
    (b":mode:synt 1\n", [Command(("mode", "synthesis"), ("1",))]),
    (b":mode 1,pos\n", [Command(("mode",), ("1", "pos"))]),
    (b":mode? 1\n", [Command(("mode",), ("1",), asks=True)]),
    (b":dem:rate 1,0\n", [Command(("demand", "rate"), ("1", "0"))]),
    (b":dem:pos 1,30\n", [Command(("demand", "position"), ("1", "30"))]),
    (b":dem:delta 1,-179\n", [Command(("demand", "delta"), ("1", "-179"))]),
    (b":dem:osc 1,0,0,0\n", [Command(("demand", "oscillation"), ("1", "0", "0", "0"))]),
    (b":limit:absolute? 1\n", [Command(("limit", "absolute"), ("1",), asks=True)]),
    (b":limit:acc? pos,1\n", [Command(("limit", "acceleration"), ("pos", "1"), asks=True)]),
    (b":lim:rate synt,1,1000\n", [Command(("limit", "rate"), ("synt", "1", "1000"))]),
    (b":limit ALL,P,100,100,1\n", [Command(("limit",), ("ALL", "P", "100", "100", "1"))]),
    (b":d:p 1,0\n", [Command(("demand", "position"), ("1", "0"))]),
    (b":m:p ALL\n", [Command(("mode", "position"), ("ALL",))]),
    (b":d:r 1,-10\n", [Command(("demand", "rate"), ("1", "-10"))]),
    (b":m:r 1\n", [Command(("mode", "rate"), ("1",))]),
]
LINES = [(line, [command]) for line, command in TCP_DRIVER] + GPIB_DRIVER
STREAM = b"".join(line for line, _ in LINES)


@pytest.mark.parametrize(("commands", "line"), CASES)
def test_a_line_is_written_and_read_as_the_same_commands(commands: list[Command], line: bytes) -> None:
    assert acutrol.encode(commands) == line
    (read,) = CommandDecoder().feed(line)
    assert [str(each) for each in read] == [str(each) for each in commands]
    assert acutrol.encode([each for each in read if isinstance(each, Command)]) == line


@pytest.mark.parametrize(("line", "commands"), LINES)
def test_what_drivers_send_is_understood(line: bytes, commands: list[Command]) -> None:
    assert CommandDecoder().feed(line) == [commands]


def test_lines_are_the_same_byte_by_byte_and_cut_anywhere() -> None:
    whole = CommandDecoder().feed(STREAM)
    assert whole == [commands for _, commands in LINES]
    decoder = CommandDecoder()
    assert [line for byte in STREAM for line in decoder.feed(bytes([byte]))] == whole
    for cut in range(len(STREAM)):
        decoder = CommandDecoder()
        assert decoder.feed(STREAM[:cut]) + decoder.feed(STREAM[cut:]) == whole


@given(st.binary(max_size=200).filter(lambda data: b"\n" not in data))
def test_garbage_costs_its_own_line(garbage: bytes) -> None:
    decoder = CommandDecoder()
    *_, last = decoder.feed(garbage + b"\n:mode? 1\r\n")
    assert last == [ask("mode", axis=1)]


def test_a_line_without_an_end_is_given_up() -> None:
    decoder = CommandDecoder()
    decoder.feed(b"x" * (acutrol.LONGEST_LINE + 1))
    assert decoder.feed(b"\n:mode? 1\n") == [[ask("mode", axis=1)]]


@pytest.mark.parametrize("text", [":demand:nothing 1", ":dem:pos:now 1", "read", ":", "?", ":read", "*rst"])
def test_what_is_no_command_is_told_as_it_stands(text: str) -> None:
    assert acutrol.parse(text) == [Unknown(text)]


def test_a_later_command_may_leave_the_branch_with_a_colon_or_by_a_word_that_is_not_in_it() -> None:
    texts = (":read:pos? 1;:mode? 1", ":read:pos? 1;mode? 1")
    assert [acutrol.parse(text)[1] for text in texts] == [ask("mode", axis=1)] * 2


ANSWERS = [
    (b"12.3;0.0;0.0", ("12.3", "0.0", "0.0")),
    (b"OK", ("OK",)),
    (b"Position", ("Position",)),
    (b"400,500,20000,0,0,440", ("400,500,20000,0,0,440",)),
]


@pytest.mark.parametrize("prefix", [b"", b"00000000", b"0012   :", b"\n\r\x00\xff1234"])
@pytest.mark.parametrize("end", [b"\n", b"\r\n"])
@pytest.mark.parametrize(("text", "texts"), ANSWERS)
def test_an_answer_ends_with_its_line_whatever_its_prefix(
    prefix: bytes, end: bytes, text: bytes, texts: tuple[str, ...]
) -> None:
    line = prefix + text + end
    assert acutrol.encode_answer(texts, prefix, end) == line
    for cut in range(len(line)):
        decoder = AnswerDecoder(len(prefix))
        first, second = decoder.feed(line[:cut]), decoder.feed(line[cut:])
        assert first is None
        assert second is not None
        assert second.texts == texts


@pytest.mark.parametrize(("text", "texts"), ANSWERS)
def test_an_answer_without_a_line_end_is_what_has_come_so_far(text: bytes, texts: tuple[str, ...]) -> None:
    decoder = AnswerDecoder(8)
    for count in range(1, 9):
        assert decoder.feed(b"0") is None
        assert decoder.so_far() is None, count
    assert decoder.feed(text) is None
    answer = decoder.so_far()
    assert answer is not None
    assert answer.texts == texts
    decoder.forget()
    assert decoder.so_far() is None


@given(st.floats(-1e6, 1e6))
def test_numbers_have_no_exponent_and_are_read_back(value: float) -> None:
    text = acutrol.number(value)
    assert "e" not in text
    assert abs(float(text) - value) <= 0.51e-5
