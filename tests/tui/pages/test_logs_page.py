"""The logs page: a list of recordings, and jobs over them in a process beside the screen."""

import json
import shutil
import signal
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers import traces
from helpers.fake_client import FakeClient
from helpers.paths import SAMPLE
from helpers.pilot import SMALLEST, See, opened
from helpers.shapes import whole

from imutui.jobs import replay, tasks
from imutui.jobs.worker import Worker
from imutui.logbook import effects_file
from imutui.logbook.reading import Reading
from imutui.logbook.results import TIMINGS, ResultDocument
from imutui.tui.pages.logs import result_text, text
from imutui.tui.pages.logs.page import LogsPage
from imutui.tui.pages.logs.result_page import ResultPage
from imutui.tui.pages.logs.result_text import Outcome
from imutui.tui.widgets.option_rows import OptionRows

SIZES = [SMALLEST, (120, 40)]
Held = list[subprocess.Popen[bytes]]


@pytest.fixture
def client(home: Path) -> FakeClient:
    """An acquisition whose folder has a finished, a cut and a still shorter recording."""
    logs = home / "logs"
    logs.mkdir()
    shutil.copy(SAMPLE, logs / "whole.mcap")
    (logs / "cut.mcap").write_bytes(SAMPLE.read_bytes()[:200_000])
    (logs / "empty.mcap").write_bytes(b"")
    made = FakeClient()
    made.changes["logs"] = str(logs)
    return made


@pytest.fixture
def held(monkeypatch: pytest.MonkeyPatch) -> Held:
    """Processes of jobs that are stopped as they start, for else a job could be done before the screen is looked at."""
    start, stopped = Worker.start, Held()

    def start_and_hold(worker: Worker) -> None:
        start(worker)
        assert worker._process is not None
        stopped.append(worker._process)
        worker._process.send_signal(signal.SIGSTOP)

    monkeypatch.setattr(Worker, "start", start_and_hold)
    return stopped


async def to_logs(see: See, name: str = "whole") -> LogsPage:
    """On the logs page, with the cursor on a recording."""
    await see("→ SIMULATED")
    await see(f"6 → {name}")
    page = see.app.screen
    assert isinstance(page, LogsPage)
    names = [line.split()[0] for line in page.query_one("#recordings", OptionRows).as_text().splitlines()]
    page.query_one("#recordings", OptionRows).highlighted = names.index(name)
    await see(f"→ {name}.mcap")
    return page


def over(app: Any) -> Callable[[], bool]:
    return lambda: isinstance(app.screen, ResultPage)


@pytest.mark.parametrize("size", SIZES)
async def test_recordings_have_length_rate_kind_and_state(client: FakeClient, size: tuple[int, int]) -> None:
    async with opened(client, size=size) as see:
        await to_logs(see, "cut")
        screen = await see("→ 3 recordings, newest first | unfinished | finished | simulated | its index")
        assert "0:00:2" in screen
        assert "20 simulated finished" in screen
        assert all(len(line) <= size[0] for line in screen.splitlines())


async def test_vi_and_arrow_keys_move_and_x_chooses(client: FakeClient) -> None:
    async with opened(client) as see:
        page = await to_logs(see)
        await see("→ t traces whole")
        await see("g x space → 2 chosen, Esc | t asks: the 2 chosen (cut, empty) or the line with the cursor")
        await see("t → Trace which? | the line with the cursor: whole | the 2 chosen: cut, empty")
        assert not page.busy()
        await see("escape k x → 1 chosen, Esc")
        assert page.query_one("#recordings", OptionRows).as_text().count(" x ") == 1
        await see("escape → t traces whole")
        assert page.query_one("#recordings", OptionRows).as_text().count(" x ") == 0


async def test_a_recording_is_noted_renamed_and_deleted_with_its_files(client: FakeClient, home: Path) -> None:
    logs = home / "logs"
    before = (logs / "whole.mcap").read_bytes()
    async with opened(client) as see:
        await to_logs(see)
        await see("n → Note of whole.mcap | stay as they are")
        await see("ctrl+a ctrl+k 'loose' enter → written to whole.mcap.notes.toml | loose (added later)")
        await see("R → Rename whole.mcap")
        await see("ctrl+a ctrl+k 'cut' enter → Rename whole.mcap | cut.mcap exists already")
        await see("end backspace*3 'kept' enter → whole.mcap is kept.mcap now | t traces kept")
        assert (logs / "kept.mcap").read_bytes() == before
        await see("D → Delete kept.mcap? | kept.mcap.notes.toml | no way back")
        await see("enter → t traces kept")
        await see("D → Delete kept.mcap?")
        await see("y → deleted kept.mcap and 1 file beside it | 2 recordings")
    assert sorted(path.name for path in logs.iterdir()) == ["cut.mcap", "empty.mcap"]


def test_what_a_trace_takes_is_told_in_the_room_there_is() -> None:
    a, b, c = (Path(f"/logs/imu400cd_{name}.mcap") for name in ("991_0900", "991_1000", "991_1100"))
    assert text.takes([], a, 78) == "t traces 991_0900"
    assert text.takes([a], a, 78) == "t traces the one chosen: 991_0900"
    assert text.takes([a, b], b, 78) == "t traces the 2 chosen: 991_0900, 991_1000; the last is held out"
    assert text.takes([a, b], c, 78) == "t asks: the 2 chosen (991_0900, 991_1000) or the line with the cursor"
    for width in range(58, 200, 7):
        assert len(text.takes([a, b, c] * 9, Path("/x.mcap"), width)) <= width


@pytest.mark.parametrize("size", SIZES)
async def test_a_replay_shows_its_result_and_saves_what_headless_gives(
    client: FakeClient, home: Path, held: Held, size: tuple[int, int]
) -> None:
    async with opened(client, size=size) as see:
        await to_logs(see)
        await see("p → replay of whole.mcap | Esc cancels")
        held.pop().send_signal(signal.SIGCONT)
        await see.until(over(see.app))
        await see("→ converged | x gyro | z accel | Table 1 | of limit | y copies")
        await see("s → whole_replay.json")
        (home / "logs" / "whole.mcap").rename(home / "logs" / "elsewhere.mcap")
        await see("s → is not there any more | Nothing is written")
        (home / "logs" / "elsewhere.mcap").rename(home / "logs" / "whole.mcap")
        await see("p → Biases over time | ── x gyro, deg/s | ── y accel, mg")
        other = json.loads((home / "logs" / "whole_replay.json").read_text())
        other["final"]["gyro_bias_dps"][0] += 0.25
        (home / "logs" / "other_replay.json").write_text(json.dumps(other))
        await see("c → Compare with | other_replay.json")
        await see("enter → A: replay of whole.mcap | B: other_replay.json | Biases beside | 0.25 deg/s")
        await see("escape → Biases over time")
        await see("escape → 3 recordings")
    saved = json.loads((home / "logs" / "whole_replay.json").read_text())
    expected = replay.replay(home / "logs" / "whole.mcap", Reading(), course=True)
    for document in (saved, expected):
        for key in TIMINGS:
            document.pop(key)
    assert saved == json.loads(json.dumps(expected))


async def test_a_trace_from_the_page_is_that_of_the_command(client: FakeClient, home: Path, held: Held) -> None:
    log = traces.imported(home / "logs" / "turns.mcap", traces.arrays(seed=4))
    async with opened(client) as see:
        page = await to_logs(see, "turns")
        await see("t → trace of turns.mcap | Esc cancels")
        assert page.busy() == ["trace of turns.mcap"]
        await see("p → one at a time")
        await see("2 → gx | counts")
        held.pop().send_signal(signal.SIGCONT)
        await see.until(lambda: not page.busy())
        await see("→ is done: 6 shows it")
        await see("6 →")
        await see.until(over(see.app))
        await see.shows("trace of turns.mcap", "gx  ")
        await see("s w → turns_effects.toml")
        await see("2 → gx | counts")
        await see("6 → l shows the last result again")
        await see("l → trace of turns.mcap | gx  ")
    saved = json.loads((home / "logs" / "turns_trace.json").read_text())
    expected = tasks.trace_logs([log], lambda share, text: None)
    assert saved == json.loads(json.dumps(expected))
    assert (home / "logs" / "turns_effects.toml").read_text() == expected["effects_file"]


async def test_esc_cancels_a_job_after_asking(client: FakeClient, home: Path, held: Held) -> None:
    """And it leaves no result behind. The job is held, or it could be done before it is cancelled."""
    before = sorted((home / "logs").iterdir())
    async with opened(client) as see:
        page = await to_logs(see)
        await see("p → Esc cancels")
        await see("escape → Cancel replay of whole.mcap? | nothing of it is kept | let it go on")
        await see("y →")
        held.pop().send_signal(signal.SIGCONT)
        await see.until(lambda: not page.busy())
        await see("→ cancelled: replay of whole.mcap")
    assert sorted((home / "logs").iterdir()) == before


async def test_a_job_that_fails_says_why(client: FakeClient, home: Path) -> None:
    (home / "logs" / "whole.mcap").write_bytes(SAMPLE.read_bytes()[:60_000])
    async with opened(client) as see:
        page = await to_logs(see, "whole")
        await see("t →")
        await see.until(lambda: not page.busy())
        await see("→ nothing can be told from its noise | 3 recordings")


async def test_a_cut_recording_is_checked_and_recovered(client: FakeClient, home: Path) -> None:
    async with opened(client) as see:
        await to_logs(see, "cut")
        await see("c →")
        await see.until(over(see.app))
        await see("→ check of cut.mcap | finding")
        await see("escape → 3 recordings")
        await see("v →")
        await see.until(over(see.app))
        await see("→ read back and found as written | cut_recovered.mcap")
        await see("escape → 4 recordings | cut_recovered")
        await see("i →")
        await see.until(over(see.app))
        await see("→ info of")
    assert (home / "logs" / "cut_recovered.mcap").exists()


async def test_found_effects_are_loaded_into_the_live_filter(client: FakeClient, home: Path) -> None:
    (home / "logs" / "a_effects.toml").write_text(effects_file.dumps(traces.trace(), "trace of a.mcap"))
    async with opened(client) as see:
        await to_logs(see)
        await see("e → a_effects.toml | gy: bias follows temperature; gx: bias drifts | trace of a.mcap")
        await see("enter → loaded a_effects.toml: the filter began anew")
        assert client.asked[-1] == "configure effects"
        client.recording = True
        await see("→ ● REC")
        await see("e → Load effects")
        await see("enter → a recording runs: r finishes it, then effects can be loaded")
        assert client.asked.count("configure effects") == 1


@pytest.mark.parametrize("size", SIZES)
async def test_a_trace_result_has_its_keys(client: FakeClient, home: Path, size: tuple[int, int]) -> None:
    found = traces.trace()
    document = traces.of_two_runs(runs=[{**traces.RUN, "seconds": 90.0}])
    effects = effects_file.dumps(found, "trace of a.mcap")
    log = home / "logs" / "a.mcap"
    log.touch()
    made = Outcome(
        "trace", "trace of a.mcap", log, document, result_text.traced(document), effects, traces.PROFILE,
    )  # fmt: skip
    async with opened(client, size=size) as see:
        await to_logs(see)
        see.app.push_screen(ResultPage(made))
        screen = await see.shows("8.41 → 1.01  █░░░", "Gauss-Markov", "q quit", "x experiment")
        await see("p → Error over what drives it")
        await see("p c →")
        await see.shows("8.41 → 1.01  █░░░", "no other trace to compare with")
        assert all(len(line) <= size[0] for line in screen.splitlines())
        await see("w → a_effects.toml")
        await see("x → wrote a_experiment.toml | Enter takes it | what to do")
        # who comes from another page has asked for the recordings
        await see("6 → also: c check | t traces whole | 4 recordings")
        assert not isinstance(see.app.screen, ResultPage)
        see.app.push_screen(ResultPage(made))
        await see.shows("8.41 → 1.01  █░░░")
        await see("t → This result has nothing for that key. | t traces.")
        await see("e → loaded gy: bias follows temperature")
        assert isinstance(see.app.screen, ResultPage)
        assert "5 Table guides through it" in " ".join(see.app.screen.as_text().split())
        await see("5 → a_experiment.toml")
    assert (home / "logs" / "a_experiment.toml").read_text() == traces.PROFILE


async def test_another_folder_or_file_can_be_opened(client: FakeClient, home: Path) -> None:
    (home / "other").mkdir()
    shutil.copy(SAMPLE, home / "other" / "elsewhere.mcap")
    async with opened(client) as see:
        await to_logs(see)
        await see.pilot.press("o", "ctrl+a", "ctrl+k", *str(home / "nowhere"), "enter")
        await see("→ There is no such folder or file")
        await see.pilot.press("ctrl+a", "ctrl+k", *str(home / "other"), "enter")
        await see("→ elsewhere | 1 recording,")


async def test_why_a_job_came_to_nothing_is_said_on_its_own_page(client: FakeClient, home: Path) -> None:
    (home / "logs" / "whole.mcap").write_bytes(SAMPLE.read_bytes()[:60_000])
    async with opened(client) as see:
        page = await to_logs(see, "whole")
        await see("t →")
        await see.shows("trace of ", "Esc cancels")
        await see("2 →")
        await see.until(lambda: not page.busy())
        said = await see("→ came to nothing: 6 says why")
        assert "in less than 20 means" not in said
        await see("6 → in less than 20 means")


async def test_the_recording_that_runs_is_traced_from_another_page(client: FakeClient, home: Path) -> None:
    client.recording = True
    async with opened(client) as see:
        await see("4 → t traces this recording")
        await see("t →")
        await see.until(lambda: see.app.current_mode == "logs")
        await see("→ 6 Logs | imu400cd_9911750")


def test_a_replay_reads_as_table_1_has_it() -> None:
    document = whole(ResultDocument, {
        "log": "a.mcap", "rate_hz": 20.0, "samples": 10, "duration_s": 0.5, "kind": "simulated",
        "filter": "spkf", "reference": "level",
        "final": {"gyro_bias_dps": [0.5, -1.25, None], "accel_bias_mg": [6.0, 0.0, 0.0]},
        "sd": {"gyro_bias_dps": [0.01, 0.01, None], "accel_bias_mg": [0.1, 0.1, 0.1]},
        "converged_s": {"gyro_bias": [9.8, None, None], "accel_bias": [None, None, None]},
        "nis": {"mean": 9.1, "dof": 9, "band95": [8.9, 9.2], "is_test": True, "why": ""},
        "noise": {"gyro_arw_deg_sqrt_h": [None] * 3, "accel_vrw_mps_sqrt_h": [None] * 3},
        "gaps": [{"t": 3.0, "seconds": 0.5}], "lost_packets": 1, "alarms": ["gz moves", "gy too"],
        "identity": {"instrument": "IMU400CD-200"},
    })  # fmt: skip
    said = result_text.replayed((), document, 100)
    for line in (
        "RED: a.mcap",
        "2 alarms: gz moves; also gy limit",
        "x gyro     0.5000  0.0300  deg/s       ±1       50 %  at 10 s",
        "125 % OUT",
        "not observable with this reference",
        "x accel     6.000   0.300  mg         ±12       50 %  not yet",
        "NIS 9.1 of 9 degrees of freedom (95 % band 8.9 to 9.2)",
        "1 packet lost, 0 bad checksums",
        "1 gap, longest 0.500 s at 3.000 s",
        "ALARM: gy too",
    ):
        assert line in said, line
    assert said.count("gz moves") == 1


def test_a_file_that_is_being_written_is_not_called_damaged() -> None:
    """The reader finds no end; whoever looks at the list knows that a recorder has it open."""
    result = traces.of_two_runs(damage=["/a/b.mcap: the file ends in the middle"])
    assert "b.mcap was being written" in result_text.traced(result, {Path("/a/b.mcap")})(80).splitlines()[0]
    assert "ends in the middle" in result_text.traced(result)(80).splitlines()[0]
