"""The application at 80×24, driven by keys."""

import time
from typing import Any, cast

import pytest
from helpers.documents import dwell, profile_toml
from helpers.fake_client import PATH, FakeClient, acquisition, result
from helpers.pilot import SMALLEST, opened

from imutui.session.client import SessionError
from imutui.session.plan import RecordingWish
from imutui.tui.pages.base import PAGES
from imutui.tui.terminal.pacing import Load
from imutui.tui.widgets.plot import Plot

FILE = PATH.rsplit("/", 1)[1]


async def test_live_has_every_vital_text_at_80x24() -> None:
    async with opened(recording=True) as see:
        screen = await see.shows("IMU400CD-200 #9911750", "SIMULATED", "● REC 0:1", "10:43:07 UTC", ">gx  ", " T  ")
        for text in (
            "deg/s", " mg ", "°C", "counts", "mean", "sd", "min", "max", "gx, deg/s, with mean", " az  ",
            "last 30 s, scroll, autoscale",
            "asked 20 measured 20.00 Hz", "lost 0", "bad checksums 0", "on for 3 min", FILE, "123 kB",
            "flush 0.4 s ago", "K/min", "q quit", "? help", "r finish",
            "filter ▲ AMBER 5 of 6", "0.3461", "1000.981",
        ):  # fmt: skip
            assert text in screen, text


async def test_a_measured_unit_is_not_called_simulated() -> None:
    async with opened(FakeClient(kind="measured")) as see:
        assert "SIMULATED" not in await see.shows("IMU400CD-200")


@pytest.mark.parametrize("size", [SMALLEST, (120, 40)])
async def test_every_line_of_every_page_fits(size: tuple[int, int]) -> None:
    async with opened(recording=True, size=size) as see:
        for key, _ in PAGES:
            await see(f"{key} →")
            lines = (await see.shows("q quit")).splitlines()
            assert len(lines) == size[1]
            assert "q quit" in lines[-1]
            assert max(widget.region.bottom for widget in see.app.screen.query("#page > *")) <= size[1]


@pytest.mark.parametrize("size", [SMALLEST, (120, 40), (200, 60)])
async def test_more_room_adds_and_moves_nothing(size: tuple[int, int]) -> None:
    async with opened(size=size) as see:
        first = "gx, deg/s, with mean" if size == SMALLEST else "gyro, deg/s"
        lines = (await see.shows(first, "now")).splitlines()
        assert lines[2].startswith("      counts     value")
        assert lines[9].startswith(" T  ")
        assert lines[10].startswith(f"── {first}")
        assert lines[-4].startswith(" asked 20")
        assert ("started at 20 Hz" in "\n".join(lines[2:10])) is (size[0] >= 112)
        for name in ("gx",) if size == SMALLEST else ("gx", "gy", "gz", "ax", "ay", "az"):
            assert any(line.startswith(f" {name} ") for line in lines[10:]), name
        if size == SMALLEST:
            assert [k for k, line in enumerate(lines[11:-4]) if "┤" in line] == [0, 3, 6]


async def test_g_shows_a_channel_then_a_quantity_then_both() -> None:
    async with opened() as see:
        await see("→ gx, deg/s, with mean")
        for there, away in (("gyro, deg/s", "accel, mg"), ("accel, mg", "gyro, deg/s")):
            await see("g →")
            await see.until(lambda away=away: away not in see.text())  # type: ignore[arg-type, misc]
            lines = (await see.shows(there)).splitlines()
            assert sum("┤" in line for line in lines) == 6
        await see("g → gyro, deg/s | accel, mg")
        await see("g → orientation of the unit | down is +z, within 0.35° | roll     -0.02° | pitch    +0.35°")


async def test_s_sweeps_then_shows_numbers_only_then_scrolls_again() -> None:
    async with opened() as see:
        await see("→ scroll, autoscale")
        await see("s → last 30 s, sweep, autoscale | 22.5 s | ⣿")
        screen = await see("s → no plot: numbers only | 0.3461")
        assert "⣿" not in screen
        await see("space → FROZEN, no plot")
        await see("s → FROZEN, last 30 s, scroll | ⣿")


async def test_a_slow_link_is_said_in_words() -> None:
    async with opened() as see:
        await see("→ scroll, autoscale")
        for second in range(0, 12, 3):
            see.app.drawing.frames.controller.judge(time.monotonic() + second, Load(stuck_s=2.0))
            if second == 0:
                await see("→ last 30 s, sweep: link is slow, autoscale")
        await see("→ no plot: link is slow | 1000.981")


@pytest.mark.parametrize("size", [SMALLEST, (120, 40)])
async def test_the_debug_line_shows_what_drawing_costs(size: tuple[int, int]) -> None:
    async with opened(size=size) as see:
        await see("ctrl+b →")
        screen = await see.shows(" fps", " kB/s", "CPU", "ms old", "queue  0", "auto scroll")
        assert len(screen.splitlines()) == size[1]
        await see("4 →")
        await see.shows(" kB/s", "NIS")
        await see("ctrl+b → !kB/s")


async def test_only_the_page_in_front_draws() -> None:
    async with opened() as see:
        await see("→ scroll, autoscale")
        plot = see.app.screen.query(Plot).first()
        await see("4 → NIS")
        before, polls = list(plot._strips), see.app._first_client.polls  # type: ignore[union-attr]
        await see.until(lambda: see.app._first_client.polls > polls + 3)  # type: ignore[union-attr]
        assert plot._strips == before
        await see("2 →")
        await see.until(lambda: plot._strips != before)


async def test_a_small_terminal_says_what_it_needs() -> None:
    async with opened(size=(79, 24)) as see:
        assert "gyro" not in await see.shows("needs 80x24", "79x24")
        await see.pilot.resize_terminal(*SMALLEST)
        await see("→ gx, deg/s")
        await see.pilot.resize_terminal(100, 20)
        await see("→ needs 80x24 | 100x20")


async def test_no_key_acts_unseen_in_a_small_terminal() -> None:
    async with opened(recording=True) as see:
        await see.pilot.resize_terminal(60, 20)
        await see("→ needs 80x24 | RECORDING goes on")
        for key in ("r", "m", "6", "t", "D", "space", "enter"):
            await see(f"{key} →")
        assert see.client.recording
        assert see.app.current_mode == "live"
        await see("q → continues")


async def test_no_color_loses_no_state(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NO_COLOR", "1")
    async with opened(recording=True) as see:
        screen = await see("→ SIMULATED | ● REC | AMBER 5 of 6 | ⣿")
        assert "lost 0" in screen
        await see("4 → AMBER | not yet")
        await see("q → recording continues")


async def test_ascii_terminals_get_ascii(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("IMUTUI_SCREEN_GLYPHS", "ascii")
    async with opened(recording=True) as see:
        assert (await see.shows("* REC", "gx, deg/s")).isascii()
        for keys, text in (
            ("4", "+-0.0291"),
            ("3", "RECORDING"),
            ("5", "5 Table"),
            ("6", "6 Logs"),
            ("1", "Connected"),
        ):
            await see(f"{keys} →")
            assert (await see.shows(text)).isascii(), see.text()
        await see("q →")
        assert (await see.shows("continues")).isascii()


async def test_r_records_and_says_which_file_it_finished() -> None:
    async with opened() as see:
        await see("→ not recording: r writes")
        await see("r → A note for this recording | Enter records, with or without")
        await see("escape → not recording: r writes")
        assert see.client.asked == []
        await see("r 'cold' → note      cold")
        await see(f"enter → recording to {PATH} | ● REC")
        assert see.client.wish == RecordingWish(note="cold")
        await see(f"r → finished {PATH}, 15246 samples | not recording")
        assert see.client.asked == ["record", "stop_recording"]


async def test_a_refusal_is_said() -> None:
    client = FakeClient()

    def refuse(note: str = "") -> str:
        raise SessionError("the disk is full: 12 MB left")

    client.changes["note"] = "cold"
    client.record = refuse  # type: ignore[method-assign]
    async with opened(client) as see:
        await see("r → the disk is full: 12 MB left")


async def test_m_marks_a_recording() -> None:
    async with opened(recording=True) as see:
        await see("m → Mark in the recording")
        await see("'rq 1' enter → marked: rq 1")
        assert see.client.asked == ["mark rq 1"]


async def test_m_without_a_recording_says_why_not() -> None:
    async with opened() as see:
        await see("→ not recording: r writes")
        await see("m → Not recording | nothing to mark | r starts a recording")
        await see("'door' enter → not recording: r writes")
        assert see.client.asked == []


async def test_space_freezes_the_view_and_not_the_data() -> None:
    async with opened() as see:
        await see("space →")
        frozen = (await see.shows("FROZEN")).splitlines()[2:20]
        polls = see.client.polls
        await see.until(lambda: see.client.polls > polls + 3)
        assert see.text().splitlines()[2:20] == frozen
        await see("escape → !FROZEN")


async def test_span_and_lock() -> None:
    async with opened() as see:
        await see("→ last 30 s, scroll, autoscale")
        await see("plus → last 60 s")
        await see("minus minus minus → last 5 s")
        await see("a → scale locked")
        await see("a → last 5 s, scroll, autoscale")


async def test_quitting_while_recording_says_what_goes_on() -> None:
    async with opened(recording=True) as see:
        await see(f"q → {FILE} | recording continues in the background | finish the file | cancel")
        await see("escape → gx, deg/s")
        await see("q → recording continues")
        await see("l →")
        await see.until(lambda: see.app._exit)
    assert see.app.return_value == 0
    assert see.client.asked == []
    assert see.client.recording
    assert "imutui attach" in see.app.farewell[1]
    assert PATH in see.app.farewell[0]


async def test_stop_and_quit_finishes_the_file() -> None:
    async with opened(recording=True) as see:
        await see("q s →")
        await see.until(lambda: see.app._exit)
    assert see.client.asked == ["stop"]
    assert f"finished {PATH}" in see.app.farewell[0]


async def test_control_keys_never_kill_a_recording() -> None:
    async with opened(recording=True) as see:
        for key in ("ctrl+c", "ctrl+q"):
            await see(f"{key} → recording continues")
            await see(f"{key} → gx, deg/s")
        assert not see.app._exit
    assert see.client.asked == []


async def test_d_detaches() -> None:
    client = FakeClient(name="bench")
    async with opened(client) as see:
        await see("d →")
        await see.until(lambda: see.app._exit)
    assert client.asked == []
    assert "imutui attach --name bench" in see.app.farewell[1]


@pytest.mark.parametrize("dialog", [[], ["q"]])
async def test_an_acquisition_that_ends_is_said_at_once(dialog: list[str]) -> None:
    async with opened(recording=True) as see:
        await see.pilot.press(*dialog)
        see.client.gone = "the cable was pulled"
        await see.shows("The acquisition has ended", "the cable was pulled", PATH[:20])
        screen = await see("c → other port")
        assert "REC" not in screen


async def test_a_stop_in_another_shell_is_said_with_who_it_was_and_no_verdict_stays() -> None:
    async with opened(recording=True) as see:
        await see("→ ● REC | filter")
        see.client.report = {
            "pid": see.client.pid, "utc": "2026-11-23T10:43:07Z", "ended_by": "the command imutui stop, ana, pid 42",
            "error": None, "findings": [], "result": result(),
        }  # fmt: skip
        see.client.gone = "the acquisition has ended"
        await see(f"→ It was ended at 10:43:07 UTC by the command imutui stop, ana | finished {PATH}")
        screen = await see("escape → ENDED | 1 connects again")
        assert not any(word in screen for word in ("GREEN", "AMBER", "REC "))
        await see("4 → at its end: AMBER")
        connection = see.app.context.connection
        assert connection._said_until - time.monotonic() <= 15.0, "what was said on another page does not stay"


async def test_after_the_end_no_page_speaks_as_if_it_ran() -> None:
    client = acquisition(recording=True)
    rest = {"kind": "dwell", "text": "go to outer 0°", "seconds": 30.0}
    profile = {"name": "x.toml", "text": profile_toml(dwell(30.0), dwell(30.0)), "align": "marks"}
    client.table_profile = cast("Any", {**profile, "segments": [rest, rest]})
    client.changes["guide"] = {"state": "hold", "segment": 0, "count": 2, "left_s": 23.0, "begun": [1.0, None]}
    client.changes["reference"] = {"name": "profile", "file": "x.toml", "profile": True}
    async with opened(client) as see:
        await see("→ ● REC | filter")
        await see("5 → 23 s left")
        client.report = {
            "pid": client.pid, "utc": "2026-11-23T10:43:07Z", "ended_by": "the command imutui stop, ana, pid 42",
            "error": None, "findings": [], "result": result(),
        }  # fmt: skip
        client.gone = "the acquisition has ended"
        await see("→ It was ended at 10:43:07 UTC")
        await see("escape →")
        assert "s left" not in await see.shows("The acquisition has ended.", "6 Logs has what was recorded")
        await see("4 t → the acquisition has ended: 6 Logs, t traces what it recorded")
        await see("3 →")
        screen = await see.shows(" ENDED ", "wrote     ", "15246 samples", "line      the acquisition has ended")
        assert "NOT RECORDING" not in screen
        assert "r records" not in screen
        await see("r → nothing to record: the acquisition has ended. 1 connects again")


async def test_an_acquisition_that_was_killed_is_said_to_be_and_its_file_to_be_recovered() -> None:
    """It leaves no word of its end, which is no calm one."""
    async with opened(recording=True) as see:
        await see("→ ● REC | filter")
        see.client.gone = "the acquisition has ended"
        await see("→ Its process was killed or broke down | v recovers what it holds")
        await see("1 → other port")


async def test_a_failed_state_is_an_end_too() -> None:
    async with opened() as see:
        see.client.changes.update(state="failed", error="no space left on the disk")
        await see("→ The acquisition has ended | no space left on the disk")
        await see("escape → ENDED | gx, deg/s")


async def test_silence_is_an_alarm() -> None:
    async with opened(silent_s=3.2) as see:
        await see("→ NO DATA for 3.2 s: check power and cable")


async def test_unknown_numbers_are_dashes() -> None:
    client = FakeClient(history_s=0.0)
    client.changes.update(
        measured_hz=None, packet_hz=None, channels=[], filter=None, events=[], series={"next": 0, "t": [], "values": []}
    )
    async with opened(client) as see:
        await see("→ measured – Hz | >gx        – | filter – OFF")
        await see("4 → OFF | no filter in this acquisition")


async def test_help_is_plain_begins_with_the_page_and_closes() -> None:
    async with opened() as see:
        for key, page, part in (("question_mark", "2", "ON THE LIVE PAGE"), ("f1", "6", "ON THE LOGS PAGE")):
            await see(f"{page} {key} → {part}")
            while "never costs a sample" not in see.text():
                await see("pageup →")
            await see("escape →")
        await see("1 f1 → FIRST STEPS | WHAT RUNS WHERE")


async def test_the_palette_has_every_action_with_its_key() -> None:
    async with opened() as see:
        commands = {command.title: command.help for command in see.app.get_system_commands(see.app.screen)}
        keys = set(commands.values())
        assert {
            f"key {key}" for key in (*"123456", "r", "m", "d", "y", "?", "q", "Ctrl-z", "space", "a", "g", "+/-")
        } <= keys
