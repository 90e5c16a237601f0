"""The table page: choosing a profile, being guided through it; what it shows is the acquisition's state."""

import threading
from pathlib import Path
from typing import Any

import pytest
from helpers.documents import dwell, profile_toml, rate
from helpers.fake_client import FakeClient
from helpers.pilot import SMALLEST, opened

from imutui.session.plan import RecordingWish
from imutui.tui.pages import requests
from imutui.tui.pages.table import profiles

SIZES = [SMALLEST, (120, 40)]
ANGLES = ((0, 0, 0), (90, 0, 0), (180, 0, 0), (-90, 0, 0))
BAD = '[[segment]]\nkind = "spin"\n'


def described() -> dict[str, Any]:
    segments = [
        {"kind": "dwell", "seconds": 30.0, "text": f"go to outer {o}°, middle {m}°, inner {i}°"} for o, m, i in ANGLES
    ]
    text = profile_toml(*(dwell(30.0, *angles) for angles in ANGLES), align="marks")
    return {"name": "tumble.toml", "text": text, "align": "marks", "segments": segments}


class Acquisition(FakeClient):
    """Takes a profile and guides through it; holding ends when a test says so."""

    def __init__(self, logs: Path) -> None:
        super().__init__()
        self.changes["logs"] = str(logs)
        self.files: list[tuple[str, str]] = []

    def configure(self, **changes: Any) -> None:
        super().configure(**changes)
        if changes.get("reference") == "level":
            self.table_profile, self.changes["guide"] = None, None
            self.changes["reference"] = {"name": "level", "file": "", "profile": False}
        elif "reference_file" in changes:
            self.files.append(changes["reference_file"])
            name, text = changes["reference_file"]
            align = "gyro" if 'align = "gyro"' in text else "marks"
            self.table_profile = {**described(), "name": name, "align": align}
            self.changes["reference"] = {"name": "profile", "file": changes["reference_file"][0], "profile": True}
            self.changes["guide"] = None

    def guide(self, do: str, wish: RecordingWish | None = None, *, yes_move: bool = False) -> None:
        super().guide(do, wish, yes_move=yes_move)
        now = self.changes.get("guide") or {"segment": 0, "begun": [None] * 4}
        begun = list(now["begun"])
        if do == "begin":
            self.recording = True
        if do == "next":
            begun[now["segment"]] = 12.0 + 40.0 * now["segment"]
        state = {"begin": "go", "next": "hold", "cancel": "cancelled", "resume": "go"}[do]
        left = 21.4 if state == "hold" else None
        self.changes["guide"] = {**now, "state": state, "count": 4, "left_s": left, "begun": begun}

    def held(self) -> None:
        """The segment's seconds are over."""
        now = self.changes["guide"]
        last = now["segment"] == 3
        self.changes["guide"] = {
            **now, "state": "done" if last else "go", "segment": now["segment"] + (not last), "left_s": None,
        }  # fmt: skip


@pytest.fixture
def folder(home: Path) -> Path:
    """A working folder with a bad profile."""
    (home / "bad.toml").write_text(BAD)
    (home / "logs").mkdir()
    return home


@pytest.mark.parametrize("size", SIZES)
async def test_a_newcomer_is_guided_from_choosing_to_the_end(folder: Path, size: tuple[int, int]) -> None:
    client = Acquisition(folder / "logs")
    async with opened(client, size=size) as see:
        await see("5 → six positions, 30 s each | ready-made | bad.toml | can't be used | bias gx gy gz")
        await see("enter → b begins. | 4 segments | joined by marks | to do | Segment 1 makes testable")
        assert client.files[0][0].endswith(".toml")
        assert 'align = "marks"' in client.files[0][1]
        await see("b → ● REC | Segment 1 of 4: go to outer 0° | I wait for you | now | next | c cancel")
        await see("enter → hold outer 0° | 21 s left of 30 s | Leave the table alone | 0:00:12")
        client.held()
        await see("→ Segment 2 of 4: go to outer 90° | done")
        await see("c → Cancelled at segment 2 of 4 | b resume")
        await see("b →")
        for _ in range(3):
            await see("→ I wait for you")
            await see("enter → s left of")
            client.held()
        await see("→ All 4 segments are done | r finishes the file, t traces it | t trace")
    assert [what for what in client.asked if what.startswith("guide")] == [
        "guide begin", "guide next", "guide cancel", "guide resume", "guide next", "guide next", "guide next",
    ]  # fmt: skip


def commanded(*, moves: bool) -> dict[str, Any]:
    """A table under command, as a snapshot has it."""
    return {
        "url": "acutrol://127.0.0.1:9888", "identity": "", "axes": ["outer", "middle", "inner"],
        "angles_deg": [0.0, 0.0, 63.68], "rates_dps": [0.0, 0.0, 40.0 * moves], "mode": "position" if moves else "off",
        "fault": "", "age_s": 0.01, "moves": moves, "error": "",
    }  # fmt: skip


@pytest.mark.parametrize("size", SIZES)
async def test_a_table_moves_after_a_yes_and_esc_stops_it_on_every_page(folder: Path, size: tuple[int, int]) -> None:
    client = Acquisition(folder / "logs")
    client.configure(reference_file=("tumble.toml", ""))
    client.changes["controller"] = commanded(moves=False)
    async with opened(client, size=size) as see:
        await see("5 → b has the table run this | inner +63.680°  mode off")
        await see("b → THE TABLE WILL MOVE | acutrol://127.0.0.1:9888 | Esc stops it")
        await see("enter → b has the table run this")
        assert not any(what.startswith("guide") for what in client.asked)
        await see("b → THE TABLE WILL MOVE")
        await see("y → ● REC | Segment 1 of 4")
        assert client.said_yes
        client.changes["controller"] = commanded(moves=True)
        await see("→ TABLE MOVES | SIMULATED | keep clear | +40.00°/s")
        for page in "12346":
            await see(f"{page} → TABLE MOVES")
        await see("escape → the table was stopped")
        client.changes["controller"] = commanded(moves=False)
        await see("5 → Stopped at segment 1 of 4 | b resume")
    assert [what for what in client.asked if what.startswith("guide")] == ["guide begin", "guide cancel"]


async def test_an_investigation_says_on_every_page_that_the_table_may_move_and_offers_no_keys_of_its_own(
    folder: Path,
) -> None:
    client = Acquisition(folder / "logs")
    client.changes["controller"] = commanded(moves=False) | {"investigates": True}
    async with opened(client, size=(80, 24)) as see:
        for page in "123":
            screen = await see(f"{page} → TABLE MAY MOVE")
            asked = list(client.asked)
            for key in "rms" if page == "1" else "rm":
                await see(f"{key} → TABLE MAY MOVE")
            assert client.asked == asked, screen
        client.changes["controller"] = commanded(moves=True) | {"investigates": True}
        await see("1 → TABLE MOVES")


@pytest.mark.parametrize("size", SIZES)
async def test_attaching_again_shows_where_the_operator_is(folder: Path, size: tuple[int, int]) -> None:
    client = Acquisition(folder / "logs")
    client.configure(reference_file=("tumble.toml", ""))
    client.recording = True
    client.changes["guide"] = {
        "state": "hold",
        "segment": 2,
        "count": 4,
        "left_s": 7.2,
        "begun": [3.0, 40.0, 80.0, None],
    }
    async with opened(client, size=size) as see:
        screen = await see("5 → Segment 3 of 4: hold outer 180° | 7 s left | 0:01:20 | bias ax ay az")
        assert max(len(line) for line in screen.splitlines()) <= size[0]


async def test_a_profile_that_cannot_be_used_says_why(folder: Path) -> None:
    client = Acquisition(folder / "logs")
    async with opened(client) as see:
        await see("5 → bad.toml")
        await see("G → bad.toml can't be used: segment 1: `kind` is 'spin'")
        await see("enter →")
        await see.until(lambda: see.text().count("`kind` is 'spin'") == 2)
        assert client.files == []


async def test_no_profile_is_taken_while_recording(folder: Path) -> None:
    client = Acquisition(folder / "logs")
    client.recording = True
    async with opened(client) as see:
        await see("5 → ready-made | r finishes the recording that runs")
        await see("enter → a recording runs: r finishes it")
        assert client.files == []


async def test_who_moves_the_table_decides_how_the_log_is_joined(folder: Path) -> None:
    client = Acquisition(folder / "logs")
    client.changes["note"] = "cold"
    (folder / "a.toml").write_text(
        "# To tell scale from bias: turn it.\n" + profile_toml(dwell(9.0), rate("inner", 30.0, 9.0), align="gyro")
    )
    async with opened(client) as see:
        await see("5 → a.toml")
        await see("G k → To tell scale from bias: turn it. | turn inner at +30 deg/s")
        await see("enter → a.toml: who moves the table?")
        await see("h → b begins.")
        assert 'align = "marks"' in client.files[0][1]
        await see("p enter → who moves the table?")
        await see("→ the filter is off meanwhile")
        await see("t → The table runs this by itself | r records; then start the table | the filter is off until")
        assert 'align = "gyro"' in client.files[1][1]
        assert "t trace" not in see.text()
        await see("r → When it has run through, r finishes the file; then t traces it")
        await see("r → Recorded: t traces the file with this profile | t trace")
        await see("t → trace of imu400cd_9911750")


async def test_what_a_trace_recommends_is_offered_first_and_can_be_copied(folder: Path) -> None:
    client = Acquisition(folder / "logs")
    recommended = "# To tell scale from bias: rest.\n" + profile_toml(dwell(9.0), align="none")
    async with opened(client) as see:
        see.app.post_message(requests.ExperimentFound(recommended, "trace of a.mcap"))
        await see("5 → experiment that the last trace wants | trace of a.mcap | To tell scale from bias: rest.")
        await see("s → Copy experiment that the last trace wants to | experiment_copy.toml")
        await see.pilot.press(*["backspace"] * len("experiment_copy.toml"), *"next.toml", "enter")
        await see("→ wrote | next.toml")
        assert (folder / "logs" / "next.toml").read_text() == recommended
        screen = await see("→ To tell scale from bias: rest.")
        assert "experiment that the last trace" not in screen
        await see.pilot.press("s", *["backspace"] * len("next_copy.toml"), *"next.toml", "enter")
        await see("→ exists and is left as it is")
        await see("enter → b begins.")
        assert 'align = "marks"' in client.files[0][1], "what rests all the time needs no question"


async def test_a_typed_path_is_taken_or_says_why_not(folder: Path) -> None:
    client = Acquisition(folder / "logs")
    elsewhere = folder / "run"
    (elsewhere / "my.toml").write_text(profile_toml(dwell(9.0), align="marks"))
    async with opened(client) as see:
        await see("5 → ready-made")
        await see("o 'run/no.toml' enter → run/no.toml: can't be read: No such file")
        await see("backspace*7 'my.toml' enter →")
        await see.until(lambda: [name for name, _ in client.files] == ["my.toml"])


async def test_begin_records_as_the_record_pages_form_says(folder: Path) -> None:
    client = Acquisition(folder / "logs")
    client.configure(reference_file=("tumble.toml", ""))
    async with opened(client) as see:
        await see("3 e tab*3 'often' → not a number")
        await see("escape 5 → b begins.")
        await see('b → not recorded: "new file every, min" is "often"')
        assert not client.recording
        await see("3 e tab*3 backspace*5 3 tab 'cold 1' escape 5 → b begins.")
        await see("b → recording; the line in bold above says what to do")
        assert client.wish == RecordingWish("cold 1", rotate_minutes=3.0)


async def test_there_is_a_way_back_from_a_profile_to_level(folder: Path) -> None:
    client = Acquisition(folder / "logs")
    client.changes["note"] = "cold"
    async with opened(client) as see:
        screen = await see("5 → six positions, 30 s each")
        assert "no profile" not in screen
        await see("enter → b begins. | six positions: 4 segments")
        await see("r → ● REC | profile six positions, 5 Table guides")
        await see("p g → no profile: still and level | lays the profile aside")
        await see("enter → a recording runs: r finishes it")
        await see("r → finished")
        await see("down up enter → no profile: still and level; the filter began anew")
        await see.until(lambda: see.text().count("no profile") == 1)
        assert client.changes["reference"]["name"] == "level"
        await see("→ Enter takes it: the filter then goes by it | what to do, and what each segment")


async def test_a_virtual_units_operator_is_warned_before_beginning(folder: Path) -> None:
    """It does not turn by hand, so its filter will contradict the profile; a real unit's page does not say so."""
    client = Acquisition(folder / "logs")
    client.configure(reference_file=("tumble.toml", ""))
    async with opened(client) as see:
        await see("5 → a virtual unit does not turn by hand | has this profile | what to do")
        client.changes["kind"] = "real"
        await see("→ !virtual unit")
        client.changes["kind"] = "simulated"
        await see("→ a virtual unit")
        await see("b → I wait for you")
        assert "virtual unit" not in see.text()


async def test_names_have_the_rows_whole_room(folder: Path) -> None:
    client = Acquisition(folder / "logs")
    async with opened(client) as see:
        screen = await see("5 → six positions, each axis ±30 ±90 deg/s | ready-made | bad.toml | can't be used")
        assert max(len(line.rstrip()) for line in screen.splitlines()) <= SMALLEST[0]


async def test_until_the_first_look_is_done_the_page_says_that_it_looks(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first look loads much; an empty list would read as if there were none."""
    may_look, look = threading.Event(), profiles.found

    def patient(folders: list[Path], _: object = None) -> Any:
        may_look.wait()
        return look(folders)

    monkeypatch.setattr(profiles, "found", patient)
    async with opened(Acquisition(folder / "logs")) as see:
        try:
            await see("→ SIMULATED")
            await see("5 → looking for profiles…")
        finally:
            may_look.set()
        screen = await see("→ six positions, 30 s each")
        assert "looking" not in screen


async def test_without_an_acquisition_profiles_can_be_looked_at(folder: Path) -> None:
    async with opened(None) as see:
        await see("→ imutui")
        await see("escape 5 → ready-made | connect first: 1 goes there | bias gx gy gz")
