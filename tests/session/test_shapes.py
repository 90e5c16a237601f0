"""What viewers get has the shape that `snapshot` and `results` say, from an acquisition and from the tests' fake."""

import json
from pathlib import Path
from typing import Any

import pytest
from helpers.acquisitions import Running, acquiring
from helpers.documents import dwell, profile_toml, rate
from helpers.fake_client import FakeClient

from imutui import declared
from imutui.estimate_history import HistorySnapshot
from imutui.logbook.results import ReadingsDocument, ResultDocument
from imutui.session import live_filter
from imutui.session.plan import HistoryWish, RecordingWish
from imutui.session.snapshot import ProfileDescription, Snapshot, StatisticsSnapshot

PROFILE = profile_toml(dwell(600.0), rate("inner", 5.0, 2.0), align="marks")


def travelled(record: Any) -> Any:
    """As it comes out of the socket."""
    return json.loads(json.dumps(record, allow_nan=False))


def mismatch(seen: Any, shape: Any, where: str) -> str:
    return declared.problem(seen, shape, where, exact=True)


def looked_at(run: Running) -> Any:
    """A snapshot, after its journey, which is found to have its shape."""
    seen = travelled(run.seen(0))
    assert mismatch(seen, Snapshot, "snapshot") == ""
    return seen


@pytest.mark.parametrize("record", [False, True])
@pytest.mark.parametrize("filtering", ["none", "level", "profile"])
def test_a_real_snapshot_has_its_shape(home: Path, record: bool, filtering: str) -> None:
    fields: dict[str, Any] = {"filter": "none"} if filtering == "none" else {"reference": filtering}
    if filtering == "profile":
        fields["reference_file"] = ("steps.toml", PROFILE)
    with acquiring(home, packets=0, record=record, **{"filter": "spkf", **fields}) as run:
        engine = run.engine
        first = looked_at(run)
        assert (first["recording"] is not None) == record
        assert (first["filter"] is not None) == (filtering != "none")
        if filtering == "profile":
            if record:
                engine.call(lambda acquisition: acquisition.stop_recording(), timeout=120.0)
            engine.call(lambda acquisition: acquisition.guidance.do("begin", RecordingWish()))
            engine.call(lambda acquisition: acquisition.guidance.do("next", RecordingWish()))
            assert looked_at(run)["guide"]["state"] == "hold"
            described = travelled(engine.call(lambda acquisition: acquisition.profile()))
            assert mismatch(described, ProfileDescription, "profile") == ""
        elif record:
            engine.call(lambda acquisition: acquisition.mark("here"))
            assert looked_at(run)["marks"][0]["text"] == "here"
        if filtering != "none":
            assert live_filter.PLAIN.ready.wait(120.0)
            while looked_at(run)["filter"]["samples"] == 0:
                pass
        past = travelled(engine.call(lambda acquisition: acquisition.history(HistoryWish()), timeout=60.0))
        assert mismatch(past, HistorySnapshot, "history") == ""
        assert past["temperature"]["t"][0] == 0.0
        assert bool(past["estimates"]["t"]) == (filtering != "none")
        told = travelled(engine.call(lambda acquisition: acquisition.channel_statistics(0), timeout=60.0))
        assert mismatch(told, StatisticsSnapshot, "statistics") == ""
        run.end()
        last = looked_at(run)
        assert last["state"] == "stopped"
        if record or filtering == "profile":
            shape = ReadingsDocument if filtering == "none" else ResultDocument
            assert mismatch(travelled(engine.result), shape, "result") == ""
        else:
            assert engine.result is None


@pytest.mark.parametrize("recording", [False, True])
def test_the_fake_of_the_tests_has_the_shape_of_a_real_acquisition(recording: bool) -> None:
    """So that no screen is tested against what no acquisition says."""
    fake = FakeClient()
    fake.recording = recording
    assert mismatch(travelled(fake.snapshot()), Snapshot, "snapshot") == ""
    assert mismatch(travelled(fake.statistics(0)), StatisticsSnapshot, "statistics") == ""


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"packets": None}, "snapshot: `packets` is None, not a whole number"),
        ({"silent_s": "long"}, "snapshot: `silent_s` is 'long', not a finite number"),
        ({"guide": {"state": "go"}}, "snapshot, guide: `segment` is missing; it is a whole number"),
        ({"state": "asleep"}, "snapshot: `state` is 'asleep', not one of: connecting"),
        ({"extra": 1}, "snapshot: `extra` is unknown; known: name"),
    ],
)
def test_what_has_another_shape_is_found(change: dict[str, Any], said: str) -> None:
    assert mismatch(travelled(FakeClient().snapshot() | change), Snapshot, "snapshot").startswith(said)
