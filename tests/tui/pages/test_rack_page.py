"""The rack page: the units of a batch, what is wrong with each, and what is asked of all or of chosen ones."""

from pathlib import Path

import pytest
from helpers.fake_batch import BAD_AXIS, Batch, Unit, settled
from helpers.pilot import SMALLEST

from imutui.session import lifecycle
from imutui.session.client import SessionGoneError


@pytest.fixture
def batch(monkeypatch: pytest.MonkeyPatch) -> Batch:
    return Batch(monkeypatch)


def row(screen: str, serial: str) -> str:
    """Line of a unit."""
    return next(line for line in screen.splitlines() if serial in line[3:13])


@pytest.mark.parametrize("size", [SMALLEST, (120, 40)])
async def test_the_bad_axis_is_found_from_the_page_alone(batch: Batch, size: tuple[int, int]) -> None:
    async with batch.opened(size) as see:
        screen = await see("→ 1 × RED  3 ● GREEN | not recording | gxyz axyz")
        assert max(map(len, screen.splitlines())) <= size[0]
        assert " ●●●  ●●× " in row(screen, "9900003")
        assert "× RED" in row(screen, "9900003")
        assert " 20.0     0 " in row(screen, "9900001")
        assert " ●●●  ●●●  2" in row(screen, "9900001")
        assert "  ● GREEN" in row(screen, "9900001")
        lines = (await see(f"w → worst first | {BAD_AXIS} | t on 4 Filter traces its recording")).splitlines()
        assert [line[3:12].strip() for line in lines[5:9]] == ["3 9900003", "1 9900001", "2 9900002", "4 9900004"]
        await see("w home → all 6 biases converged")


async def test_a_mark_goes_to_all_and_to_chosen_ones(batch: Batch) -> None:
    async with batch.opened() as see:
        await see("m → no unit records: r starts recordings")
        await see("r → ● REC 4 of 4 | recording: 4 units")
        await see("m 'door' enter → marked: door: 4 units")
        await see("j x x → 2 chosen, Esc: none")
        await see("m 'fan' enter → marked: fan: 2 units")
        await see("escape n 'lot 8' enter → noted: 4 units")
    both = ["record", "mark door", "mark fan", "describe lot 8 None"]
    alone = ["record", "mark door", "describe lot 8 None"]
    assert batch.asked() == [alone, both, both, alone]


async def test_starting_asks_for_a_note_where_there_is_none_and_finishing_asks(batch: Batch) -> None:
    batch.units["lot:2"].changes["note"] = ""
    async with batch.opened() as see:
        await see("r → A note for the recordings")
        await see("'lot 9' enter → ● REC 4 of 4")
        await see("r → Finish the files? | 4 units: 1 9900001, 2")
        await see("escape → ● REC 4 of 4")
        await see("r f → finished: 4 units | not recording")
    assert {unit.wish.note for unit in batch.units.values() if unit.wish} == {"lot 9"}


async def test_one_step_of_the_table_serves_all(batch: Batch) -> None:
    for unit in batch.units.values():
        unit.at("")
    async with batch.opened() as see:
        await see("→ Table profile six: 6 segments, 3 min without the moves | b begins, and records: 4 units")
        await see("b → Segment 1 of 6: go to outer 0° | t: the table is there, for 4 units | ● REC 4 of 4")
        await see("t → Segment 1 of 6: hold outer 0° | 30 s left for 4 units")
        await see("t → not now: Segment 1 of 6")
        for unit in batch.units.values():
            unit.at("go", 1)
        batch.units["lot:4"].at("go", 0)  # one that was exchanged begins anew
        await see("→ Segment 2 of 6: go to outer 60° | for 3 units. 1 unit waits for another segment")
        await see("t → hold outer 60° | 30 s left for 3 units")
        await see("c → cancelled: 4 units | six is cancelled | b resumes 4 units")
    assert [asked.count("guide next") for asked in batch.asked()] == [2, 2, 2, 1]


async def test_what_all_units_have_in_common_is_told_of_the_table(batch: Batch) -> None:
    for n, unit in enumerate(batch.units.values()):
        said = f"segment 4: {('ax', 'az')[n % 2]} reads 971.4 mg less than the model: 83 deg off"
        unit.changes["filter"] = settled(departure=said)
    async with batch.opened() as see:
        await see("→ 4 × RED | All depart from the model at segment 4: look at table, profile or room first")
        batch.units["lot:4"].changes["filter"] = settled()
        await see("→ 1 ● | !All depart")


async def test_a_narrow_row_says_what_is_waited_for_and_not_what_is_well(batch: Batch) -> None:
    batch.units["lot:1"].changes["filter"] = settled(temperature_k_per_min=0.6)
    async with batch.opened() as see:
        screen = await see("→ 1 ▲ | all 6 biases converged, but temperature moves them")
        assert "▲ AMBER temperature moves" in row(screen, "9900001")


async def test_ten_units_fit_the_smallest_terminal_with_all_that_is_said(batch: Batch) -> None:
    batch.units = {f"lot:{n}": Unit(n) for n in range(10)}
    for unit in batch.units.values():
        unit.at("go", 3)
        unit.changes["filter"] = settled(departure=BAD_AXIS)
    async with batch.opened() as see:
        screen = await see("end → All depart | 9900009: IMU400CD | speaks against the unit | t on 4 Filter | d detach")
        assert all(row(screen, f"990000{n}") for n in range(10))


async def test_a_unit_that_fails_stays_as_a_row_while_the_others_go_on(batch: Batch) -> None:
    async with batch.opened() as see:
        batch.units["lot:2"].gone = 'the acquisition "lot:2" has ended.'
        screen = await see("→ × ENDED")
        assert "× ENDED" in row(screen, "9900002")
        await see("w → it left no word | S starts it again")
        await see("enter → 9900002 does not run: there is nothing to look at")
        await see("r → recording: 3 units | ● REC 3 of 4")
        batch.units["lot:2"] = Unit(2)  # another one is in its place
        await see("→ 9900002 | 3 ● GREEN | !ENDED")


async def test_one_that_refuses_keeps_no_other_from_it(batch: Batch, monkeypatch: pytest.MonkeyPatch) -> None:
    async with batch.opened() as see:
        await see("r → ● REC 4 of 4")

        def refuse(text: str) -> None:
            raise SessionGoneError(f"no room for {text}")

        monkeypatch.setattr(batch.units["lot:4"], "mark", refuse)
        await see("m 'door' enter → marked: door: 3 of 4 units | 4: no room for door")


async def test_enter_goes_to_a_unit_and_0_comes_back(batch: Batch) -> None:
    async with batch.opened() as see:
        await see("j j enter → IMU400CD-200 #9900003 | 0 Rack | last 30 s | × RED")
        await see("4 → 9900003 | az reads 5.0 mg more")
        await see("0 → batch lot | 9900001 | gxyz axyz")
        assert see.app.context.connection.client is None
        await see("4 → az reads 5.0 mg more than the model | NIS")
        batch.units["lot:3"].gone = 'the acquisition "lot:3" has ended.'
        await see("→ The acquisition has ended | back to all units")
        await see("0 → batch lot | × ENDED")


@pytest.mark.parametrize(("key", "stopped"), [("l", False), ("s", True)])
async def test_quitting_asks_what_becomes_of_all_units(batch: Batch, key: str, stopped: bool) -> None:
    async with batch.opened() as see:
        await see("q → The batch lot is running | 4 units of it are | imutui attach --batch lot comes back")
        await see(f"{key} →")
        await see.until(lambda: see.app.return_code is not None)
        said = "stopped: 4 units" if stopped else "The batch lot goes on: 4 units."
        assert see.app.farewell[0] == said
    assert all(asked == (["stop"] if stopped else []) for asked in batch.asked())


async def test_s_stops_a_unit_after_asking(batch: Batch) -> None:
    async with batch.opened() as see:
        await see("j s → Stop these units? | 1 unit: 2 9900002")
        await see("s → stopped: 1 unit | × ENDED")
    assert batch.asked() == [[], ["stop"], [], []]


async def test_one_that_was_asked_to_end_is_no_fault(batch: Batch, home: Path) -> None:
    ended = lifecycle.Lifecycle("lot:2")
    ended.stop("ana on pts/1")
    lifecycle.write_end(ended.report())
    async with batch.opened() as see:
        batch.units["lot:2"].gone = 'the acquisition "lot:2" has ended.'
        await see("j → – ENDED | ended by ana on pts/1 | 1 × RED  2 ● GREEN | S starts it again")
        lifecycle.write_end(lifecycle.failed("lot:2", lifecycle.DISK, "the disk is full"))
        await see("→ × ENDED | the disk is full | 2 × RED")


async def test_one_profile_is_taken_for_all_while_none_records(batch: Batch, home: Path) -> None:
    async with batch.opened() as see:
        await see("p → A table profile for all | six positions, 30 s each, 7 segments")
        await see("1 → is taken: 4 units")
        await see("r → ● REC 4 of 4")
        await see("p → finish the recordings first")
    assert batch.asked() == [["configure reference_file", "record"]] * 4
