"""Recordings as other programs write them: each is taken as it was meant, or refused with a command that then works."""

import gzip
import re
import shlex
import tracemalloc
from collections.abc import Callable
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from helpers.commands import imutui, imutui_json

from imutui.logbook import reader
from imutui.logbook.importing import recording as recordings
from imutui.logbook.importing import scale, text
from imutui.logbook.importing.rows import Part
from imutui.logbook.importing.table import Asked, Column, Rows, Table

N, HZ = 400, 100.0
NAMES = ["t", *(f"{sensor}_{axis}" for sensor in ("gyro", "accel") for axis in "xyz"), "temp"]
SIX = NAMES[1:7]
_rng = np.random.default_rng(5)
TIME = np.arange(N) / HZ
GYRO = np.array([0.1, -0.2, 0.3]) + _rng.normal(0.0, 0.05, (N, 3))
ACCEL = np.array([0.002, -0.003, 0.999]) + _rng.normal(0.0, 1e-3, (N, 3))
DATA = np.column_stack([TIME, GYRO, ACCEL, 25.0 + TIME]).round(9)


def lines(data: np.ndarray = DATA, *, names: list[str] | None = NAMES, separator: str = ",") -> list[str]:
    """A table as text."""
    rows = [separator.join(map(repr, row)) for row in data.tolist()]
    return [separator.join(names), *rows] if names else rows


def changed(change: Callable[[np.ndarray], None], data: np.ndarray = DATA) -> np.ndarray:
    """A copy of the data after a change."""
    copy = data.copy()
    change(copy)
    return copy


def csv(data: np.ndarray = DATA, **style: object) -> bytes:
    """A table as the bytes of a file."""
    return ("\n".join(lines(data, **style)) + "\n").encode()  # type: ignore[arg-type]


def scaled(columns: slice, factor: float, offset: float = 0.0) -> bytes:
    """The table with columns in another unit."""
    return csv(changed(lambda d: d.__setitem__((slice(None), columns), d[:, columns] * factor + offset)))


def moved(row: int | slice, seconds: float) -> bytes:
    """The table with stamps that are off."""
    return csv(changed(lambda d: d.__setitem__((row, 0), d[row, 0] + seconds)))


def imported(path: Path, *flags: str, tries: int = 3) -> tuple[reader.Log, list[str], str]:
    """A recording's log, the commands of messages that were followed until it was taken, and what was said then."""
    words = ["import", str(path), "-o", str(path.with_suffix(".mcap")), "--gravity", "9.80665", *flags]
    followed: list[str] = []
    for _ in range(tries):
        done = imutui(*words, check=None)
        if done.returncode == 0:
            return reader.read(path.with_suffix(".mcap")), followed, done.stderr
        assert done.returncode == 3, done.stderr
        commands = re.findall(r"`imutui (import [^`]*)`", done.stderr)
        assert commands, done.stderr
        followed.append(commands[0])
        words = shlex.split(commands[0])
    raise AssertionError(done.stderr)


def assert_same(log: reader.Log, rows: np.ndarray | slice = slice(None), *, tolerance: float = 1e-8) -> None:
    """The log holds these rows of the data."""
    axes = log.info.axes()
    want = DATA[rows]
    assert np.allclose(np.rad2deg(axes.gyro_to_instrument(log.samples.gyro)), want[:, 1:4], atol=tolerance)
    assert np.allclose(axes.accel_to_instrument(log.samples.accel) / 9.80665, want[:, 4:7], atol=tolerance)


# ------------------------------------------------------------------------------------------------------------- dialects

TEXT = "\n".join(lines()) + "\n"
DIALECTS: dict[str, bytes] = {
    "semicolons": csv(separator=";"),
    "semicolons and decimal commas": csv(separator=";").replace(b".", b","),
    "blanks and decimal commas": csv(separator=" ").replace(b".", b","),
    "tabs": csv(separator="\t"),
    "bars": csv(separator="|"),
    "columns of blanks": TEXT.replace(",", "   ").encode(),
    "blanks after commas": TEXT.replace(",", ", ").encode(),
    "UTF-16 with its mark": TEXT.encode("utf-16"),
    "UTF-16 without": TEXT.encode("utf-16-be"),
    "a mark of UTF-8": b"\xef\xbb\xbf" + TEXT.encode(),
    "Latin-1": TEXT.replace("temp", "Temperatur [°C]").encode("latin-1"),
    "line ends of DOS": TEXT.replace("\n", "\r\n").encode(),
    "line ends doubled": TEXT.replace("\n", "\r\r\n").encode(),
    "line ends of the old Mac": TEXT.replace("\n", "\r").encode(),
    "blank lines": TEXT.replace("\n", "\n\n").encode(),
    "all in quotes": ("\n".join('"' + line.replace(",", '","') + '"' for line in lines()) + "\n").encode(),
    "decimal commas in quotes": (
        "\n".join(
            [
                lines()[0],
                *('"' + line.replace(".", "d").replace(",", '","').replace("d", ",") + '"' for line in lines()[1:]),
            ]
        )
    ).encode(),
    "names behind a #": b"#" + TEXT.encode(),
    "remarks before and between": ("# a logger\n" + TEXT.replace("\n", "\n# a door\n", 200)).encode(),
    "a preamble": ("Logger 2\nSerial: 17\n\n" + TEXT).encode(),
    "a row of units": TEXT.replace("temp\n", "temp\ns,deg/s,deg/s,deg/s,g,g,g,degC\n").encode(),
    "rows that end with a comma": TEXT.replace("\n", ",\n").encode(),
    "a note with commas": TEXT.replace("\n", ',"ok, fine"\n').encode(),
    "numbers of rows": "".join(f"{k},{line}\n" for k, line in enumerate(lines())).replace("0,t", ",t").encode(),
    "gzip": gzip.compress(TEXT.encode()),
    "NUL bytes at the end": TEXT.encode() + b"\0" * 4096,
    "minus signs of typography": TEXT.replace("-", "\N{MINUS SIGN}").encode(),
    "capital names": TEXT.replace(lines()[0], lines()[0].upper()).encode(),
    "short names": TEXT.replace(lines()[0], "time,gx,gy,gz,ax,ay,az,temperature").encode(),
    "units in names": TEXT.replace(lines()[0], "t (s),gx_dps,gy_dps,gz_dps,AccX [g],AccY [g],AccZ [g],T (°C)").encode(),
}


@pytest.mark.parametrize("name", DIALECTS)
def test_a_csv_of_any_dialect_holds_the_same(tmp_path: Path, name: str) -> None:
    path = tmp_path / "recording.txt"
    path.write_bytes(DIALECTS[name])
    found = recordings.load(path).whole()
    assert np.array_equal(found.t, DATA[:, 0])
    assert np.array_equal(found.gyro_dps, DATA[:, 1:4])
    assert np.array_equal(found.accel_g, DATA[:, 4:7])


@pytest.mark.parametrize("block", [300, 1000, 4096])
def test_where_blocks_of_the_file_end_changes_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, block: int
) -> None:
    """Blocks end within lines, characters of UTF-16 and pairs of line ends."""
    monkeypatch.setattr(text, "_BLOCK", block)
    for name in ("UTF-16 with its mark", "line ends of DOS", "columns of blanks", "gzip"):
        path = tmp_path / "recording.csv"
        path.write_bytes(DIALECTS[name])
        recording = recordings.load(path)
        assert np.array_equal(recording.whole().gyro_dps, DATA[:, 1:4]), name
        assert recording.samples == N


def test_every_bit_of_a_number_is_read(tmp_path: Path) -> None:
    rng = np.random.default_rng(8)
    gyro = rng.normal(size=(2000, 3)) * 10.0 ** rng.integers(-9, 3, (2000, 3))
    path = tmp_path / "a.csv"
    rows = (f"{k / 64!r},{','.join(map(repr, row))},0.0,0.0,1.0" for k, row in enumerate(gyro.tolist()))
    path.write_text("\n".join([",".join(NAMES[:7]), *rows]) + "\n")
    assert np.array_equal(recordings.load(path, Asked(units="gyro:deg/s")).whole().gyro_dps, gyro)


STAMPS = {
    "a date of the United States at midnight": ("%m/%d/%Y %H:%M:%S.%f", "2024-05-03 23:59:58"),
    "a date of Europe at midnight": ("%d/%m/%Y %H:%M:%S.%f", "2024-05-03 23:59:58"),
    "a date with the hours of noon": ("%m/%d/%Y %I:%M:%S.%f PM", "2024-05-13 12:59:58"),
    "a time of day before noon": ("%I:%M:%S.%f AM", "2024-05-13 12:00:01"),
    "minutes and seconds": ("%M:%S.%f", "2024-05-13 10:00:58"),
}


@pytest.mark.parametrize("name", STAMPS)
def test_dates_and_times_of_day_are_read(tmp_path: Path, name: str) -> None:
    form, first = STAMPS[name]
    stamps = [(datetime.fromisoformat(first) + timedelta(milliseconds=10 * k)).strftime(form) for k in range(N)]
    path = tmp_path / "a.csv"
    rows = [f"{stamp},{line.partition(',')[2]}" for stamp, line in zip(stamps, lines()[1:], strict=True)]
    path.write_text("\n".join([lines()[0], *rows, ""]))
    log, followed, _ = imported(path)
    assert not followed
    assert_same(log)
    assert np.allclose(log.seconds(), TIME, atol=1e-7)


def test_a_date_that_is_missing_costs_its_row(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    rows = [f"2024-05-13 10:00:0{k / 100:.2f},{line.partition(',')[2]}" for k, line in enumerate(lines()[1:])]
    rows[7] = rows[7].partition(",")[1] + rows[7].partition(",")[2]
    path.write_text("\n".join([lines()[0], *rows, ""]))
    log, followed, _ = imported(path)
    assert "--drop 7" in followed[0]
    assert_same(log, np.arange(N) != 7)


UNITS = {
    "rad/s": ("gx (radians/second)", np.pi / 180), "mrad/s": ("gx [mrad/s]", np.pi / 0.18), "rpm": ("gx [rpm]", 1 / 6),
    "cm/s2": ("ax [cm/s^2]", 980.665), "ug": ("ax [µg]", 1e6), "m/s2": ("ax [m/(sec^2)]", 9.80665),
    "mm/s2": ("ax [mm/s²]", 9806.65),
}  # fmt: skip


@pytest.mark.parametrize("unit", UNITS)
def test_units_in_names_are_read(tmp_path: Path, unit: str) -> None:
    name, factor = UNITS[unit]
    which = slice(1, 4) if name[0] == "g" else slice(4, 7)
    path = tmp_path / "a.csv"
    names = [*NAMES]
    names[which] = [name.replace("x ", f"{axis} ") for axis in "xyz"]
    path.write_bytes(csv(changed(lambda d: d.__setitem__((..., which), d[:, which] * factor)), names=names))
    log, followed, said = imported(path)
    assert not followed
    assert f"{'gyro' if name[0] == 'g' else 'accel'} in {unit}" in said
    assert_same(log)


def test_a_name_with_a_minus_turns_the_sign(tmp_path: Path) -> None:
    """As loggers name the axes of a unit that is built in the other way round."""
    path, data = tmp_path / "a.csv", DATA.copy()
    data[:, [2, 5]] *= -1.0
    names = [f"-{name}" if k in (2, 5) else name for k, name in enumerate(NAMES)]
    path.write_text("\n".join([*lines(data, names=names), ""]))
    log, followed, said = imported(path)
    assert not followed
    assert_same(log)
    assert f"-{NAMES[5]}, whose sign is turned" in said


@pytest.mark.parametrize("row", ["", "s,arcsec/s,arcsec/s,arcsec/s,g,g,g,degC\n"])
def test_a_unit_that_is_not_known_is_not_taken_for_ours(tmp_path: Path, row: str) -> None:
    path = tmp_path / "a.csv"
    names = NAMES[0], *(f"gyro_{axis}{'' if row else ' [arcsec/s]'}" for axis in "xyz"), *NAMES[4:]
    path.write_text("\n".join([",".join(names), *row.splitlines(), *lines()[1:], ""]))
    words = imutui("import", path, "-o", tmp_path / "b.mcap", check=3).stderr
    assert 'the unit of `gyro_x` is "arcsec/s", which is not known' in words
    assert_same(imported(path)[0])


def test_a_recording_of_more_than_ten_years_has_another_unit(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(scaled(slice(0, 1), 1e9))
    log, followed, _ = imported(path, "--units", "t:s")
    assert "--units t:ns" in followed[0]
    assert np.allclose(log.seconds(), TIME, atol=1e-7)


ARRAYS: dict[str, dict[str, object]] = {
    "ns of 64 bits without sign": {"timestamps": (1.717e18 + TIME * 1e9).astype(np.uint64)},
    "lengths of time": {"t": np.round(TIME * 1e9).astype("timedelta64[ns]")},
    "a row": {"t": TIME[None]},
    "a column": {"t": TIME[:, None]},
    "an unknown unit": {"t": TIME, "units": '{"gyro": "arcsec/s"}'},
}


@pytest.mark.parametrize("name", ARRAYS)
def test_arrays_of_other_kinds_are_taken_or_refused_with_a_command(tmp_path: Path, name: str) -> None:
    path = tmp_path / "a.npz"
    np.savez(path, gyro=DATA[:, 1:4], accel=DATA[:, 4:7], **ARRAYS[name])
    log, followed, _ = imported(path)
    assert len(followed) == (name[:2] in ("ns", "an"))
    assert_same(log)
    assert np.allclose(log.seconds(), TIME, atol=1e-6)


def test_rows_without_a_reading_make_no_motion(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(csv(changed(lambda d: d.__setitem__((slice(None, None, 2), slice(4, 7)), np.nan))))
    _, _, said = imported(path)
    assert "the unit moves" not in said


def test_a_temperature_in_counts_is_left_out(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(scaled(slice(7, 8), 340.0, -12420.0))
    log, followed, _ = imported(path)
    assert "temp=none" in followed[0]
    assert_same(log)


def test_stamps_that_cannot_be_read_are_named(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("\n".join([lines()[0], *(f"T{line}" for line in lines()[1:]), ""]))
    log, followed, _ = imported(path)
    assert followed[0].endswith("--columns t=row:100Hz --gravity 9.80665")
    assert_same(log)
    path.write_text("\n".join([lines()[0], *(line.replace(",", ",x", 1) for line in lines()[1:]), ""]))
    words = ("import", path, "-o", tmp_path / "b.mcap")
    assert 'has "x0.' in imutui(*words, check=3).stderr
    assert "Mend them in the program" in imutui(*words, check=3).stderr
    assert "Mend them in the program" in imutui(*words, "--columns", "t=row:100Hz", check=3).stderr


# ------------------------------------------------------------------------------------------------- refused, then taken

REFUSED: dict[str, tuple[bytes, str]] = {
    "ms": (scaled(slice(0, 1), 1e3), "--units t:ms"),
    "us since 1970": (scaled(slice(0, 1), 1e6, 1.7e15), "--units t:us"),
    "days": (scaled(slice(0, 1), 1 / 86400.0, 45000.0), "--units t:d"),
    "m/s²": (scaled(slice(4, 7), 9.80665), "accel:m/s2, gyro:deg/s"),
    "milli-g": (scaled(slice(4, 7), 1e3), "accel:mg, gyro:deg/s"),
    "rad/s": (scaled(slice(1, 4), np.pi / 180), "--units gyro:rad/s"),
    "kelvin": (scaled(slice(7, 8), 1.0, 273.15), "--units temp:K"),
    "SI": (
        csv(DATA * np.r_[1.0, [np.pi / 180] * 3, [9.80665] * 3, 1.0]),
        "--units 'accel:m/s2, gyro:rad/s'",
    ),
    "counts": (csv(DATA * np.r_[1.0, [131.0] * 3, [16384.0] * 3, 1.0]), "accel:g/16384, gyro:deg/s/131"),
    "no names": (csv(names=None), "t=#1, gyro_x=#2, gyro_y=#3, gyro_z=#4, accel_x=#5"),
    "accelerometers first, no names": (csv(DATA[:, [0, 4, 5, 6, 1, 2, 3]], names=None), "gyro_x=#5"),
    "no time": (csv(DATA[:, 1:], names=NAMES[1:]), "t=row:100Hz"),
    "a counter": (
        csv(changed(lambda d: d.__setitem__((slice(None), 0), np.arange(N))), names=["PacketCounter", *NAMES[1:]]),
        "t=PacketCounter:100Hz",
    ),
    "two units side by side": (csv(np.hstack([DATA, DATA[:, 1:] + 1.0]), names=[*NAMES, *NAMES[1:]]), "gyro_x=#2"),
    "two units by names": (
        csv(np.hstack([DATA[:, :7], DATA[:, 1:7] + 1.0]), names=["t", *(f"imu{k}_{n}" for k in (0, 1) for n in SIX)]),
        "gyro_x=imu0_gyro_x",
    ),
    "ms by the name of many": (
        scaled(slice(0, 1), 1e3, 1.7e12).replace(b"t,", b"timestamps,", 1), "--units t:ms"
    ),
    "stamps in steps of 0.1 s": (csv(np.hstack([np.floor(DATA[:, :1] * 10) / 10, DATA[:, 1:]])), "arrival"),
    "stamps that stand still": (csv(changed(lambda d: d.__setitem__((..., 0), 1.7e9))), "t=row:100Hz"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_may_be_misread_is_refused_with_a_command_that_then_works(tmp_path: Path, name: str) -> None:
    path = tmp_path / "recording.csv"
    path.write_bytes(REFUSED[name][0])
    log, followed, _ = imported(path)
    assert len(followed) == 1
    assert REFUSED[name][1] in followed[0]
    assert_same(log)
    assert np.allclose(log.seconds(), TIME, atol=2e-6)


def test_rates_in_radians_are_told_by_how_gravity_turns(tmp_path: Path) -> None:
    """Of a unit that moves, noise tells nothing."""
    t = np.arange(2000) / HZ
    angle = np.deg2rad(30.0) * np.sin(t)
    moving = np.column_stack([t, 0 * t, np.gradient(angle, t), 0 * t, -np.sin(angle), 0 * t, np.cos(angle)])
    moving[:, 1:] += np.random.default_rng(2).normal(0.0, 1e-3, (t.size, 6))
    for factor, asked in ((1.0, True), (180.0 / np.pi, False)):
        path = tmp_path / f"{asked}.csv"
        path.write_bytes(csv(moving * np.r_[1.0, [factor] * 3, [1.0] * 3], names=NAMES[:7]))
        assert [("gyro:rad/s" in command) for command in imported(path)[1]] == [True] * asked


def test_gyros_alone_are_taken_where_gravity_was_removed(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(csv(changed(lambda d: d.__setitem__((..., slice(4, 7)), d[:, 4:7] - [0.0, 0.0, 1.0]))))
    log, followed, _ = imported(path)
    assert "accel=none" in followed[0]
    assert np.isnan(log.samples.accel).all()


@pytest.mark.parametrize(
    ("rows", "off"),
    [([0], 1e9), ([200], 1e9), ([200], -5.0), ([N - 2], -5.0), ([50, 51, 52], 2000.0), ([20, 100, 300], -5.0)],
)
def test_bad_stamps_are_named_with_the_option_that_drops_them(tmp_path: Path, rows: list[int], off: float) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(csv(changed(lambda d: d.__setitem__((rows, 0), d[rows, 0] + off))))
    log, followed, _ = imported(path)
    assert len(followed) == 1
    assert ", ".join(map(str, rows)) in followed[0]
    assert_same(log, np.setdiff1d(np.arange(N), rows))


def test_a_part_before_a_bad_stamp_is_taken(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(moved(300, 1e9))
    log, followed, _ = imported(path, "--end", "2.5")
    assert not followed
    assert_same(log, slice(0, 251))


@pytest.mark.parametrize(
    ("line", "words"),
    [("2.0,1,2", "has 3 cells where others have 8"), ("2.0,1,ERR,3,0,0,1,25", '"ERR" in column `gyro_y`')],
)
def test_a_row_that_cannot_be_read_is_never_passed_over_in_silence(tmp_path: Path, line: str, words: str) -> None:
    path = tmp_path / "a.csv"
    path.write_text("\n".join([*lines()[:201], line, *lines()[202:]]))
    assert words in imutui("import", path, "-o", tmp_path / "b.mcap", check=3).stderr
    log, followed, _ = imported(path)
    assert "--drop 200" in followed[0]
    assert_same(log, np.arange(N) != 200)


def test_units_that_take_turns_are_not_one_bursty_unit(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    both = np.repeat(DATA, 2, axis=0)
    both[1::2, 1:] += 0.5
    path.write_bytes(csv(both))
    log, followed, _ = imported(path)
    assert "--drop 1::2" in followed[0]
    assert_same(log)


# -------------------------------------------------------------------------------------------------------------- assumed

ASSUMED: dict[str, tuple[bytes, str]] = {
    "a clock set back an hour": (moved(slice(200, None), -3600.0), "set back by 3600 s at row 200"),
    "a clock set back 50 ms": (moved(slice(200, None), -0.05), "set back by 0.05 s at row 200"),
    "seconds that begin anew each minute": (
        csv(changed(lambda d: d.__setitem__((..., 0), (d[:, 0] + 58.0) % 60.0))), "set back by 60 s at row 200"
    ),
    "two rows swapped": (csv(DATA[np.r_[0:100, 101, 100, 102:N]]), "2 rows (the first is 100) put in order"),
    "two buffers of twenty rows swapped": (
        csv(DATA[np.r_[0:100, 120:140, 100:120, 140:N]]), "40 rows (the first is 100) put in order"
    ),
    "a row twice": (csv(DATA[np.r_[0:100, 99, 100:N]]), "left out row 100"),
    "fifty rows twice": (csv(DATA[np.r_[0:100, 50:100, 100:N]]), "left out 50 rows (the first is 100)"),
    "a first line that is cut": ("\n".join([lines()[0], "1.0,2.0,25.0", *lines()[1:], ""]).encode(), "1 line(s)"),
    "NUL bytes in the middle": (csv().replace(lines()[50].encode(), b"\0" * 900 + lines()[50].encode()), "NUL bytes"),
    "a last line that is cut": (csv()[:-9], "its last line is cut"),
    "names that stand again": ("\n".join([*lines()[:100], lines()[0], *lines()[100:]]).encode(), "again in line 101"),
}  # fmt: skip


@pytest.mark.parametrize("block", [9000, 10000, 11000, 12000])
def test_buffers_are_put_in_order_wherever_blocks_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, block: int
) -> None:
    monkeypatch.setattr(text, "_BLOCK", block)
    path = tmp_path / "a.csv"
    path.write_bytes(
        csv(DATA[np.arange(N).reshape(-1, 20)[[*range(8), 9, 8, 10, 12, 11, 13, 14, 16, 15, 17, 18, 19]].ravel()])
    )
    assert_same(imported(path)[0])


@pytest.mark.parametrize("name", ASSUMED)
def test_what_was_assumed_is_one_line_and_in_the_document(tmp_path: Path, name: str) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(ASSUMED[name][0])
    log, followed, said = imported(path)
    assert not followed
    (line,) = [line for line in said.splitlines() if "assumed: " in line]
    assert ASSUMED[name][1] in line
    count = N - name.startswith("a last")
    assert_same(log, slice(0, count))
    assert np.allclose(log.seconds(), TIME[:count], atol=1e-7)
    document = imutui_json("import", path, "-o", tmp_path / "b.mcap", "--gravity", "9.80665")
    assert "; ".join(document["assumed"]) == line.split("assumed: ")[1]


def test_a_gap_is_a_gap_and_no_slow_rate(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(moved(slice(200, None), 10800.0))
    log, _, said = imported(path)
    assert "gap(s) in time, the longest of 10800" in said
    assert "bursts" not in said
    assert log.info.rate_hz == pytest.approx(HZ)


def test_temperature_now_and_then_holds_and_blank_readings_are_none(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    rows = [line if k % 100 == 0 else line.rpartition(",")[0] + "," for k, line in enumerate(lines()[1:])]
    cells = rows[50].split(",")
    rows[50] = ",".join([cells[0], "", "", "nan", *cells[4:]])
    path.write_text("\n".join([lines()[0], *rows, ""]))
    log, _, said = imported(path)
    assert log.samples.degc.tolist() == np.repeat(DATA[::100, 7], 100)[: len(log.samples)].tolist()
    assert np.flatnonzero(~log.samples.valid).tolist() == [50]
    assert "`temp` has 4 readings" in said


def test_one_glitch_makes_no_motion_and_keeps_the_check_of_the_sign(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(csv(changed(lambda d: d.__setitem__((7, slice(1, 7)), [-250, 250, -250, 16, -16, 16]))))
    said = imutui("import", path, "-o", tmp_path / "b.mcap", "--accel-sign", "+1", check=3).stderr
    assert "its z is up" in said
    assert "moves" not in imported(path)[2]


def test_memory_does_not_grow_with_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Peaks of two files, one four times as long."""
    monkeypatch.setattr(text, "_BLOCK", 2**16)
    monkeypatch.setattr(scale, "_ROWS", 1000)
    monkeypatch.setattr(scale, "_MOST_SAMPLED", 1000)
    peaks = []
    for copies in (20, 80):
        data = np.tile(DATA, (copies, 1))
        data[:, 0] = np.arange(len(data)) / HZ
        path = tmp_path / f"{copies}.csv"
        path.write_bytes(csv(data))
        recordings.load(path)
        tracemalloc.start()
        assert sum(piece.t.size for piece in recordings.load(path).pieces()) == len(data)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.2 * peaks[0]


def test_what_is_looked_at_again_does_not_keep_all_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scale, "_ROWS", 1000)
    monkeypatch.setattr(scale, "_MOST_SAMPLED", 1000)
    look = scale.Look()
    tracemalloc.start()
    for k in range(400):
        rows = np.full((1000, 7), float(k))
        look.take(Part(rows[:, 0], np.arange(1000), {}), rows)
    held, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert held < 1_000_000


def test_another_source_of_pieces_is_a_table_of_columns(tmp_path: Path) -> None:
    """A bag's reader gives integer ns and SI with their units, and all checks hold for it."""
    path = tmp_path / "a.bag"
    path.write_bytes(b"")
    stamps = 1_700_000_000_123_456_789 + np.arange(N) * 10_000_000
    columns = [stamps, *np.deg2rad(DATA[:, 1:4]).T, *(DATA[:, 4:7] * 9.80665).T]

    def pieces(chosen: list[int]) -> list[Rows]:
        return [(k / N, [columns[c][k : k + 150] for c in chosen]) for k in range(0, N, 150)]

    units = ["ns", *["rad/s"] * 3, *["m/s2"] * 3]
    made = tuple(Column(name, unit) for name, unit in zip(NAMES, units, strict=False))
    recording = recordings.of_table(Table(path, made, lambda chosen: iter(pieces(list(chosen)))), Asked())
    found = recording.whole()
    assert np.allclose(found.t, TIME, atol=1e-12)
    assert np.allclose(found.gyro_dps, DATA[:, 1:4], atol=1e-12)
    assert recording.clock_s == pytest.approx(1_700_000_000.123456789)
