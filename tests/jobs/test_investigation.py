"""An investigation ends by itself, says why each motion was made, and goes on after any stop."""

import json
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest
from helpers.runs import WHITE, run_of

from filters.errors import InputError
from filters.simulation import Effect, Scenario
from filters.tracing import table_motions
from filters.tracing.candidate_motions import CandidateMotion
from filters.tracing.run import Run
from filters.tracing.table_motions import AxisRange, Table
from filters.tracing.trace import trace
from filters.tracing.trace_document import TraceFindings
from imutui.jobs.investigation import OVERHEAD_S, Investigation
from imutui.jobs.investigation_diary import DIARY, Diary, RoundEntry

TABLE: Table = {"inner": AxisRange(math.radians(100.0), math.radians(100.0))}
SCALE = Effect("scale", ("gz",), {"relative": 0.004})


class StoppedError(Exception):
    """Somebody stopped the table."""


class Laboratory:
    """A simulated unit on a table with one axis; each log is a file with the number of its run.

    `stops_at`: number of the motion that is stopped in its middle.
    """

    table = TABLE

    def __init__(self, folder: Path, effects: Sequence[Effect], stops_at: int = 0, begun_s: float = 0.0) -> None:
        self._folder, self._effects, self._stops_at = folder, tuple(effects), stops_at
        self._begun_s = self._time_s = begun_s
        self.made: list[str] = []

    def now_s(self) -> float:
        return self._time_s - self._begun_s

    def record(self, motion: CandidateMotion, number: int) -> str:
        self.made.append(motion.description)
        begins = self._time_s + OVERHEAD_S
        if number == self._stops_at:
            self._time_s = begins + 0.5 * motion.seconds
            raise StoppedError
        self._time_s = begins + motion.seconds
        name = f"{number:02d}"
        (self._folder / name).write_text(json.dumps({"begins": begins, "seconds": motion.seconds}))
        KEPT[self._folder / name] = self._run(motion, name, number, begins)
        return name

    def _run(self, motion: CandidateMotion, name: str, number: int, begins: float) -> Run:
        # one unit: the same biases in each run, other noise
        bias = {"accel_bias": (0.02, -0.01, 0.03), "gyro_bias": (0.001, 0.002, -0.001)}
        scenario = Scenario(seed=number, spec=WHITE, profile=motion.profile, effects=self._effects, **bias)
        run = run_of(scenario, seconds=motion.seconds, hz=10.0)
        return replace(run, name=name, power_on="one", begins=begins, history_known=number > 1, temperature=None)

    def runs(self, rounds: Sequence[RoundEntry]) -> list[Run]:
        return [KEPT[self._folder / entry["log"]] for entry in rounds]

    def judged(self, rounds: Sequence[RoundEntry]) -> TraceFindings:
        *fitted, held = self.runs(rounds)
        return trace(fitted, held).document


KEPT: dict[Path, Run] = {}


def test_a_clean_unit_makes_each_kind_of_motion_once(tmp_path: Path) -> None:
    """Where nothing is wrong only what was not made yet is worth a motion; what is held out confirms it."""
    laboratory = Laboratory(tmp_path, ())
    diary = Diary.begun(1.0, tmp_path)
    assert Investigation(laboratory, diary).go() == "explained"
    kinds = [entry["kind"] for entry in diary.made]
    assert kinds == ["start", "start", *["round"] * (len(kinds) - 3), "held_out"]
    motions = [entry["motion"] for entry in diary.made]
    assert {motion.description for motion in table_motions.rounds(TABLE, None)} <= set(motions)
    assert len(set(motions)) == len(motions)
    assert set(diary.made[-1]["status"].values()) == {"clean"}
    assert diary.document["takes"] == []


def test_a_cause_is_sought_in_rounds_and_a_cut_round_is_made_again(tmp_path: Path) -> None:
    """After a stop amid a motion the diary has all before it; who goes on makes that one again, and comes to an end."""
    first = Laboratory(tmp_path, [SCALE], stops_at=3)
    going = Investigation(first, Diary.begun(1.0, tmp_path))
    with pytest.raises(StoppedError):
        going.go()
    going.pause()
    on_disk = json.loads((tmp_path / DIARY).read_text())
    assert [entry["log"] for entry in on_disk["rounds"]] == ["01", "02", ""]
    assert on_disk["spent_s"] == pytest.approx(first.now_s(), abs=0.1)

    diary = Diary.read(tmp_path)
    assert len(diary.made) == 2
    second = Laboratory(tmp_path, [SCALE], begun_s=first.now_s())
    outcome = Investigation(second, diary).go()
    assert second.made[0] == first.made[-1]
    assert outcome in ("explained", "not_here")
    rounds = diary.made
    assert rounds[-1]["kind"] == "held_out"
    chosen = [entry for entry in rounds if entry["kind"] == "round"]
    assert chosen
    assert all(entry["expected_bits"] >= 1.0 for entry in chosen)
    assert any("gz" in entry["why"] for entry in chosen)
    assert any(names["channel"] == "gz" for entry in rounds for names in entry["rivals"])
    assert rounds[-1]["status"]["gz"] in ("explained", "confounded")
    assert all(entry["came"] for entry in rounds)
    starts = [entry["start_s"] for entry in rounds]
    assert starts == sorted(starts)
    assert json.loads((tmp_path / DIARY).read_text()) == diary.document


def test_after_a_switch_a_run_of_the_new_power_on_judges(tmp_path: Path) -> None:
    """What goes with time or temperature is told by that alone: it comes first where nothing else is worth a motion."""
    laboratory = Laboratory(tmp_path, ())
    diary = Diary.begun(1.5, tmp_path)
    Investigation(laboratory, diary).go()
    before = len(diary.made)
    diary.document |= {"power_on": 1, "outcome": ""}
    assert Investigation(laboratory, diary).go() == "explained"
    assert [(r["kind"], r["power_on"]) for r in diary.made[before:]] == [("held_out", 1)]


def test_time_that_does_not_suffice_is_refused_before_anything_moves(tmp_path: Path) -> None:
    """What every unit is taken through and the run that judges must fit; the message says how long they take."""
    laboratory = Laboratory(tmp_path, ())
    with pytest.raises(InputError, match=r"take 0\.\d+ h"):
        Investigation(laboratory, Diary.begun(0.05, tmp_path))
    assert laboratory.made == []


def test_when_time_is_up_the_last_run_judges_and_it_is_said(tmp_path: Path) -> None:
    """Its time is reserved: with no time for a round the held-out run is made all the same."""
    laboratory = Laboratory(tmp_path, [SCALE])
    diary = Diary.begun(0.165, tmp_path)
    assert Investigation(laboratory, diary).go() == "time"
    assert [entry["kind"] for entry in diary.made] == ["start", "start", "held_out"]
    assert laboratory.now_s() < 0.165 * 3600.0


def test_a_folder_is_of_one_investigation(tmp_path: Path) -> None:
    """A second one is refused, and so is going on where nothing was begun, or where a log is gone."""
    with pytest.raises(InputError, match="nothing to go on with"):
        Diary.read(tmp_path)
    diary = Diary.begun(1.0, tmp_path)
    diary.save()
    with pytest.raises(InputError, match="--resume"):
        Diary.begun(1.0, tmp_path)
    laboratory = Laboratory(tmp_path, (), stops_at=2)
    with pytest.raises(StoppedError):
        Investigation(laboratory, Diary.read(tmp_path)).go()
    (tmp_path / "01").unlink()
    with pytest.raises(InputError, match="01 is not there"):
        Diary.read(tmp_path)


def test_a_diary_of_another_version_is_refused_with_the_command_that_begins_anew(tmp_path: Path) -> None:
    diary = Diary.begun(1.0, tmp_path)
    diary.document["asked"] |= {"port": "/dev/ttyUSB0", "controller": "acutrol://table:9000"}
    diary.document["version"] = 0
    diary.save()
    with pytest.raises(InputError, match="its version is 0, not 1") as told:
        Diary.read(tmp_path)
    anew = "imutui investigate --port /dev/ttyUSB0 --controller acutrol://table:9000 --hours H -o DIR"
    assert f"`{anew}` begins anew" in str(told.value)


@pytest.mark.parametrize("text", ["[]", "{", '{"version": 1, "hours": "two"}'])
def test_a_diary_that_is_none_is_refused_in_words(tmp_path: Path, text: str) -> None:
    """Whatever the file holds, it is told that it is no diary."""
    (tmp_path / DIARY).write_text(text)
    with pytest.raises(InputError, match="diary"):
        Diary.read(tmp_path)
