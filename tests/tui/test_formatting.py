"""Numbers and names as text, and the signs that a terminal has."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from imutui.tui import formatting
from imutui.tui.terminal import glyphs


def test_digits_do_not_dance() -> None:
    assert {len(formatting.number(v, 9, 3)) for v in (0.0, -1001.2214, 7.5, None, float("nan"))} == {9}


def test_zero_has_no_sign() -> None:
    assert formatting.number(-0.0001, 6, 2) == "  0.00"


def test_points_stand_below_each_other() -> None:
    four, three = formatting.aligned(0.3461, 10, 4, 4), formatting.aligned(-6.112, 10, 3, 4)
    assert four.index(".") == three.index(".")
    assert len(four) == len(three) == 10


def test_long_names_keep_both_ends() -> None:
    """The end of a port name tells two adapters apart."""
    short = formatting.port_name("/dev/serial/by-id/usb-FTDI_FT232R_USB_UART_A9-if00-port0", 20)
    assert len(short) == 20
    assert short.startswith("usb-FTDI")
    assert short.endswith("port0")
    assert formatting.port_name("/dev/pts/1") == "pts/1"


@pytest.mark.parametrize(
    ("count", "said"),
    [(None, "–"), (999, "999 B"), (1234, "1 kB"), (12_345_678, "12.3 MB"), (2_345_678_901, "2.35 GB")],
)
def test_sizes_have_decimal_prefixes(count: int | None, said: str) -> None:
    assert formatting.size(count) == said


def test_clocks_and_times() -> None:
    assert formatting.clock(3 * 3600 + 62) == "3:01:02"
    assert formatting.utc_time("2026-11-21T10:43:07Z") == "10:43:07"
    assert formatting.minutes(125 * 60) == "2 h 05 min"


@pytest.mark.parametrize(
    ("environ", "name"),
    [
        ({}, "braille"),
        ({"TERM": "linux"}, "block"),
        ({"TERM": "linux", "IMUTUI_SCREEN_GLYPHS": "braille"}, "braille"),
        ({"IMUTUI_SCREEN_GLYPHS": "ascii"}, "ascii"),
        ({"TERM": "vt100"}, "ascii"),
        ({"LANG": "de_DE.ISO-8859-1"}, "ascii"),
    ],
)
def test_glyphs_fit_the_terminal(environ: dict[str, str], name: str) -> None:
    assert glyphs.choose(environ).name == name


def test_ascii_means_ascii() -> None:
    assert glyphs.GLYPHS["ascii"].text("● ± Δ ° ▕··│██▏ – ┤─ ▲ … − ² ≥ ×").isascii()


def test_a_shortened_path_keeps_the_files_name() -> None:
    path = "/tmp/pytest-of-ana/a_long_name_for_a_folder/logs/imu400cd_9911750_20261121T104307Z.mcap"
    for width in range(40, 90):
        shown = formatting.shorten_path(path, width)
        assert len(shown) <= width
        assert shown.endswith("/imu400cd_9911750_20261121T104307Z.mcap")
    assert formatting.shorten_path(path, 60) == "/tmp/pytest-of-ana/…/imu400cd_9911750_20261121T104307Z.mcap"
    assert formatting.shorten_path(path, 20) == formatting.shorten(path.rpartition("/")[2], 20)
    assert formatting.shorten_path("a.mcap", 20) == "a.mcap"


@given(st.lists(st.text("0123abT_", min_size=1, max_size=40), unique=True, max_size=8), st.integers(8, 30))
def test_different_names_stay_different_however_little_room_there_is(names: list[str], width: int) -> None:
    shown = formatting.apart(names, width)
    assert len(set(shown)) == len(names)
    assert max(map(len, shown), default=0) <= width
    assert all(short == name for short, name in zip(shown, names, strict=True) if len(name) <= width)


def test_what_differs_in_names_stays() -> None:
    times = [f"9911750_20261127T08{minute}12Z_demo" for minute in (14, 15)]
    assert formatting.apart(times, 13) == ["…081412Z_demo", "…081512Z_demo"]
    middle = [f"imu400cd_9911750_{day}_the_same_long_note" for day in ("monday", "tuesday")]
    assert [name for name, day in zip(formatting.apart(middle, 13), ("mon", "tue"), strict=True) if day in name]


def test_a_long_path_is_broken_behind_separators() -> None:
    path = "/tmp/" + "/".join(["a_folder_of_some_length"] * 5) + "/cut_recovered.mcap"
    said = formatting.folded(f"recovered: {path} and more", 40)
    assert max(map(len, said.split("\n"))) <= 40
    assert "cut_recovered.mcap and more" in said
    assert said.replace("\n", "") == f"recovered: {path} and more"
    assert formatting.folded("many short words, " * 9, 40) == "many short words, " * 9
