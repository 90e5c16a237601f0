"""The acquisition process on a virtual instrument's pseudo-terminal: real processes, real signals, real files.

The unit at the other end is served by the test's own process, but where the acquisition starts one itself.
"""

import json
import os
import stat
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import unit_time
from helpers import ros_messages
from helpers.acquisitions import replayed, unread, untimed
from helpers.blocks import block_of
from helpers.commands import imutui, imutui_json, imutui_process
from helpers.documents import dwell, effect, effects_toml, profile_toml, state, toml
from helpers.places import own_places
from helpers.processes import LIMIT_S, wait_until
from helpers.tap import packets_of
from helpers.units import virtual

from filters.errors import InputError
from imutui.instrument.clock import Stamp
from imutui.instrument.imu400.crossbow import Mode, Packet
from imutui.logbook import reader
from imutui.logbook.session_info import SessionInfo
from imutui.session import client, ipc
from imutui.session.client import SessionError
from imutui.session.plan import Plan, RecordingWish
from imutui.verdict import sources

PROFILE = profile_toml(dwell(3.0), dwell(60.0, inner=90.0), align="marks")
EFFECTS = effects_toml(effect("thermal_lin", "gy", state("k", "deg/s/K", 0.02, 0.01)))


Start = Callable[..., client.Client]


@pytest.fixture
def start(home: Path) -> Iterator[Start]:
    """Start an acquisition of a virtual unit that this process serves: what is not said is as `plan` has it."""
    with ExitStack() as units:

        def begin(tap: Path | None = None, **fields: Any) -> client.Client:
            return client.start(plan(home, port=units.enter_context(virtual(tap)), **fields))

        yield begin


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """An acquisition that several tests look at, without filter and without a folder for recordings; its own folder."""
    folder = tmp_path_factory.mktemp("running")
    (folder / "logs").touch()
    with pytest.MonkeyPatch.context() as patch, virtual() as port:
        own_places(patch, folder)
        connection = client.start(plan(folder, port=port, record=False, rate_hz=20.0, filter="none"))
        yield folder
        connection.stop()


@pytest.fixture
def watched(home: Path, running: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[client.Client]:
    """A viewer of it, who must leave it as it was."""
    own_places(monkeypatch, running)
    connection = client.attach()
    yield connection
    state = connection.snapshot()
    assert (state["state"], state["recording"], state["effects"]) == ("running", None, [])
    connection.close()


def plan(home: Path, **fields: Any) -> Plan:
    return Plan(**({"port": "virtual", "logs": str(home / "logs"), "record": True} | fields))


def test_live_and_replayed_results_are_equal(home: Path) -> None:
    cases = ((133.0, "stream", 4.0), (20.0, "stream", 4.0), (20.0, "polled", 4.0), (1.0, "polled", 6.0))

    def recorded(rate: float, sampling: str, seconds: float) -> dict[str, Any]:
        asked = plan(home, rate_hz=rate, sampling=sampling, duration_s=seconds, name=f"{sampling}-{rate:.0f}")
        with virtual() as port:
            return client.start(replace(asked, port=port, note=asked.name)).wait(60.0)["result"] or {}

    with ThreadPoolExecutor(len(cases)) as pool:
        for case, live in zip(cases, pool.map(recorded, *zip(*cases, strict=True)), strict=True):
            assert untimed(live) == replayed(live["log"], code=1), case
            assert (live["site_stated"], live["site_sd_mg"]) == (False, [0.0, 0.0, pytest.approx(2.6)]), case
            if case[1] == "polled":  # a poll that a busy machine is late for is late or left out; most are not
                period = np.median(np.diff(reader.read(Path(live["log"])).seconds()))
                assert period == pytest.approx(1.0 / case[0], rel=0.15), case
            else:  # who streams waits for no host; the virtual unit itself may be held up on a busy machine
                assert live["rate_hz"] == pytest.approx(case[0], rel=0.05), case
                assert live["lost_packets"] == 0, case
            assert live["bad_checksums"] == 0, case
            assert live["kind"] == "simulated", case


def test_a_measured_recording_played_to_the_wire_comes_back_count_for_count(
    home: Path, recording: Callable[[str], Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    source = recording("aceinna_imu381_s1_static.npz")
    with unit_time.virtual("--from", str(source), "--tap", str(home / "sent")) as (port, environment):
        for name in ("PYTHONPATH", "IMUTUI_TEST_UNIT_TIME"):
            monkeypatch.setenv(name, environment[name])
        asked = plan(home, port=port, rate_hz=20.0, duration_s=30.0, accel_sign=1, mount="x,-y,-z", reference="gravity")
        live = client.start(asked).wait(120.0)["result"]
    assert live is not None
    log = reader.read(Path(live["log"]), raw=True)
    assert [(*p.counts, p.temperature, p.ticks) for p in ros_messages.packets(log)] == packets_of(home / "sent")[
        : len(ros_messages.packets(log))
    ]
    assert [p.sequence for p in ros_messages.packets(log)] == list(range(len(ros_messages.packets(log))))
    assert len(ros_messages.packets(log)) >= 30 * 133
    assert untimed(live) == replayed(live["log"], code=1)
    # 20 readings a second, each sent until the next one
    assert {"ax", "ay", "az"} <= {each["channel"] for each in live["health"] if each["kind"] == "repeated"}
    assert live["unobservable"] == ["accel_bias_x", "accel_bias_y"]
    assert live["kind"] == "unknown"
    with np.load(source) as measured:
        still = measured["gyro"][: 30 * 20].mean(axis=0)
    assert np.allclose(live["final"]["gyro_bias_dps"], still, atol=0.015)


def test_a_cause_that_is_seen_live_is_an_event_and_withdrawn_by_one(home: Path, tmp_path: Path) -> None:
    """A level that is left after 25 s is a step for as long as it lasts."""
    steps = [{"name": "step", "channel": "gy", "dps": dps, "at_s": at} for dps, at in ((0.9, 60.0), (-0.9, 85.0))]
    scenario, path = tmp_path / "unit.toml", tmp_path / "a.mcap"
    scenario.write_text(toml(seed=3, temperature={"history": [[0.0, 25.0]]}, effect=steps))
    unit_time.acquire(scenario, 0, path, 170.0, "--filter", "spkf")
    log = reader.read(path)
    told = [(event.name, event.text) for event in log.events if event.name.startswith("cause")]
    assert all("channel=gy" in text for _, text in told)
    events = [(name, text.partition("effect=")[2].split()[0]) for name, text in told]
    assert events[0] == ("cause", "step")
    assert sorted(events[1:]) == [("cause", "telegraph"), ("cause_gone", "step")]
    result = replayed(path, code=None)  # 1: so large a level is no good unit's
    assert [one["effect"] for one in result["causes"]] == ["telegraph"]
    assert [one["effect"] for one in result["causes_gone"]] == ["step"]


def test_a_demo_recovers_known_biases(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("IMUTUI_SITE_GRAVITY_MPS2", "9.819")
    with unit_time.own():
        result = imutui_json("demo", "--headless", "--seconds", "30", "--seed", "7")
    for key, limit in (("accel_bias_mg", 0.6), ("gyro_bias_dps", 0.05)):
        error = np.array(result["final"][key]) - result["truth"][key]
        assert np.all(np.abs(error) < 3 * np.array(result["sd"][key]))
        assert np.all(np.array(result["sd"][key]) < limit)
        assert None not in result["converged_s"][key.rsplit("_", 1)[0]]
    assert result["finished"]
    assert result["truth"].keys() == result["final"].keys()
    assert result["kind"] == "simulated"
    assert reader.read(Path(result["log"])).finished
    # the virtual unit stands where the demo says that it does, wherever the configuration has the user
    assert (result["seed"], result["site_stated"], result["site_sd_mg"]) == (7, True, [0.0, 0.0, 0.0])
    own = {"truth", "seed"}  # of the demo's unit; a replay's seed is that of drawn measurements
    assert {k: v for k, v in replayed(result["log"]).items() if k not in own} == {
        k: v for k, v in untimed(result).items() if k not in own
    }


def test_a_recording_is_started_marked_and_finished_from_outside(start: Start) -> None:
    connection = start(record=False, rate_hz=20.0)
    assert "not recording" in imutui_process("status").stdout
    assert imutui("mark", "too early", check=4).stderr.count("recorded") == 1
    path = connection.record(RecordingWish(note="first run"))
    assert Path(path).name.endswith("_first-run.mcap")
    imutui_process("mark", "table at 90 deg")
    wait_until(lambda: (connection.snapshot(2**62)["recording"] or {}).get("samples", 0) > 20)
    status = imutui_json("status")[0]
    assert status["recording"]["path"] == path
    # so short a recording leaves biases that have not converged, which `stop` says as `record` does
    result = json.loads(imutui_process("stop", "--json", check=1).stdout)
    assert result["log"] == path
    # a viewer that comes too late to ask reads who it was, and what became of the file
    report = connection.end()
    assert report["ended_by"].startswith("the command imutui stop, ")
    assert int(report["ended_by"].rpartition("pid ")[2]) != os.getpid()
    assert (report["error"], report["result"]["log"]) == (None, path)
    log = reader.read(Path(path))
    assert log.events[-1].text == f"ended by {report['ended_by']}"
    assert [e.text for e in log.events if e.name == "mark"] == ["table at 90 deg"]
    assert log.info.note == "first run"
    assert log.finished
    assert client.running() == []


def test_one_acquisition_a_name(start: Start) -> None:
    plain = {"rate_hz": 20.0, "filter": "none"}
    first = start(**plain)
    with pytest.raises(SessionError, match="imutui attach"):
        start(**plain)
    second = start(**plain, name="second")
    assert client.running() == ["default", "second"]
    with pytest.raises(SessionError, match="--name"):
        client.attach()
    second.stop()
    assert client.attach().pid == first.pid
    first.stop()


def test_nobody_else_may_talk_to_it(watched: client.Client) -> None:
    assert stat.S_IMODE(ipc.folder().stat().st_mode) == 0o700
    assert stat.S_IMODE(ipc.socket_path("default").stat().st_mode) == 0o600


@pytest.mark.parametrize("variable", ["XDG_RUNTIME_DIR", "XDG_CACHE_HOME"])
def test_a_folder_with_a_long_path_holds_a_socket_too(
    home: Path, start: Start, monkeypatch: pytest.MonkeyPatch, variable: str
) -> None:
    """Socket addresses end at 108 bytes; folders need not, as that in a home folder without a runtime folder."""
    deep = home / ("x" * 120)
    deep.mkdir(mode=0o700)
    monkeypatch.delenv("XDG_RUNTIME_DIR")
    monkeypatch.setenv(variable, str(deep))
    connection = start(rate_hz=20.0, filter="none")
    assert client.attach().pid == connection.pid
    assert deep in ipc.socket_path("default").parents
    connection.stop()


def test_the_series_is_handed_out_once(watched: client.Client) -> None:
    first = watched.snapshot(0)["series"]
    wait_until(lambda: watched.snapshot(2**62)["series"]["next"] > first["next"] + 50)
    second = watched.snapshot(first["next"])["series"]
    assert len(second["t"]) == second["next"] - first["next"]
    t = np.array(first["t"] + second["t"])
    assert np.all(np.diff(t) > 0)
    assert np.median(np.diff(t)) == pytest.approx(0.0075, abs=2e-4)


def test_a_viewer_that_waits_piece_by_piece_leaves_nothing_behind(watched: client.Client) -> None:
    """As `record` does in a terminal: no thread and no open socket stays in the acquisition for each time it looked."""
    process = Path(f"/proc/{watched.pid}")
    before = len(list((process / "task").iterdir())), len(list((process / "fd").iterdir()))
    for _ in range(20):
        with pytest.raises(TimeoutError):
            watched.wait(0.01)
    wait_until(lambda: (len(list((process / "task").iterdir())), len(list((process / "fd").iterdir()))) <= before)


def summary(log: reader.Log) -> dict[str, Any]:
    """What was written into the file as it was finished: the live result, but for the file's own hash."""
    return dict(json.loads(log.attachments["summary.json"]))


def test_a_recording_in_several_files_loses_no_packet_and_has_none_twice(home: Path, start: Start) -> None:
    asked = {"rate_hz": 133.0, "duration_s": 4.5, "rotate_minutes": 1.25 / 60.0, "note": "long"}
    live = start(home / "sent", **asked).wait(120.0)["result"]
    assert live is not None
    paths = [Path(part["log"]) for part in live["parts"]]
    assert paths[-1] == Path(live["log"])
    assert [path.stem.removeprefix(paths[0].stem) for path in paths] == ["", "_p2", "_p3", "_p4"]
    logs = [reader.read(path, raw=True) for path in paths]
    joined = [packet for log in logs for packet in ros_messages.packets(log)]
    assert [(*p.counts, p.temperature, p.ticks) for p in joined] == packets_of(home / "sent")[: len(joined)]
    steps = np.diff([p.ticks for p in joined]) % 65536
    assert np.ptp(steps) <= 1, "the unit's own counter goes through the joints as it does elsewhere"
    # the duration counts from the first file's first packet
    assert len(joined) == pytest.approx(4.5 * 133.3, abs=24)
    for log, path in zip(logs, paths, strict=True):
        assert log.finished
        assert [p.sequence for p in ros_messages.packets(log)] == list(range(len(ros_messages.packets(log))))
        again = replayed(path, code=1)
        kept = summary(log)
        assert kept.pop("verdict") == sources.of_document(again).word
        assert untimed(again) | {"log_sha256": None} == untimed(kept)
        assert again["lost_packets"] == again["bad_checksums"] == 0
    assert "continued in" in logs[0].events[-1].text
    assert f"continues {paths[0].name}" in " ".join(event.text for event in logs[1].events)


def test_the_command_records_in_several_files_with_what_its_flags_say(home: Path) -> None:
    flags = ("--operator", "ana", "--place", "cellar", "--table", "AC-120", "--rotate-minutes", "0.025")
    record = ("record", "--port", "virtual", "--filter", "none", "--rate", "20", "--duration", "4", "--json")
    with unit_time.own():
        done = imutui(*record, *flags, "-o", "a.mcap")
    result = json.loads(done.stdout)
    assert [Path(part["log"]).name for part in result["parts"]] == ["a.mcap", "a_p2.mcap", "a_p3.mcap"]
    assert "recorded in 3 files" in done.stderr
    for part in result["parts"]:
        info = reader.read(Path(part["log"])).info
        assert (info.operator, info.place, info.table) == ("ana", "cellar", "AC-120")
    assert "`acquisition.rotate_minutes` is -1.0" in imutui(*record, "--rotate-minutes", "-1", check=2).stderr


def test_what_the_operator_says_of_a_recording_is_in_the_file_and_stays_for_the_next(home: Path, start: Start) -> None:
    connection = start(record=False, rate_hz=20.0, place="cellar", note="demo", filter="none")
    wish = RecordingWish(note="first", operator="ana", table="AC-120", rotate_mb=0.03)
    first = Path(connection.record(wish))
    # in its third file, and with something in it
    wait_until(lambda: (now := connection.snapshot(2**62)["recording"])["part"] == 3 and now["samples"] > 1)
    state = connection.snapshot(2**62)
    assert (state["operator"], state["place"], state["table"], state["note"]) == ("ana", "cellar", "AC-120", "first")
    assert (state["rotate_minutes"], state["rotate_mb"]) == (0.0, 0.03)
    assert state["free_bytes"] > 0
    parts = [Path(part["log"]) for part in connection.stop_recording()["parts"]]
    assert parts[0] == first
    second = Path(connection.record(RecordingWish(rotate_mb=0.0)))
    wait_until(lambda: connection.snapshot(2**62)["recording"]["samples"] > 1)
    connection.stop_recording()
    emptied = Path(connection.record(RecordingWish(note="", operator="", place="", table="")))
    wait_until(lambda: connection.snapshot(2**62)["recording"]["samples"] > 1)
    connection.stop()
    info = reader.read(emptied).info
    assert (info.operator, info.place, info.table, info.note) == ("", "", "", "")
    for path in (*parts, second):
        info = reader.read(path).info
        assert (info.operator, info.place, info.table) == ("ana", "cellar", "AC-120")
    assert {path.name for path in parts} == {path.name for path in (home / "logs").glob("*first*.mcap")}
    # but for the last, each has its size, give or take what came within a second
    assert all(path.stat().st_size > 30_000 for path in parts[:-1])
    assert reader.read(second).info.note == ""


def test_a_folder_that_cannot_be_made_costs_the_recording_and_nothing_else(watched: client.Client) -> None:
    with pytest.raises(SessionError, match="Choose another folder"):
        watched.record(RecordingWish(operator="ana"))
    state = watched.snapshot(2**62)
    assert (state["state"], state["recording"], state["filter"]) == ("running", None, None)
    assert state["operator"] != "ana"


@pytest.mark.parametrize(("sampling", "filtered"), [("stream", "spkf"), ("polled", "none")])
def test_zeroed_rate_sensors_read_zero_and_nothing_counts_as_lost(start: Start, sampling: str, filtered: str) -> None:
    connection = start(rate_hz=50.0, sampling=sampling, filter=filtered)
    with pytest.raises(SessionError, match="finish the recording first: r"):
        connection.zero(10)
    connection.stop_recording()
    with pytest.raises(SessionError, match="one byte"):
        connection.zero(256)
    before = connection.snapshot(2**62)
    said: list[str] = []
    thread = threading.Thread(target=lambda: said.append(connection.zero(60)))
    thread.start()
    wait_until(lambda: bool(connection.snapshot(2**62)["zeroing"]))
    for refused in (connection.record, lambda: connection.configure(reference="level"), lambda: connection.zero(1)):
        with pytest.raises(SessionError, match="wait until it is done"):
            refused()
    thread.join(LIMIT_S)
    assert "zeroed its rate sensors" in said[0]
    zeroed = connection.snapshot(2**62)["packets"]
    wait_until(lambda: connection.snapshot(2**62)["packets"] > zeroed + 150)
    state = connection.snapshot(2**62)
    noise = connection.statistics(0)
    assert noise["stretches"] >= 2
    assert noise["allan"] is not None
    assert max(noise["allan"]["deviation"]) < 1.5 * state["channels"][0]["sd"]  # type: ignore[operator]
    means = np.array([[c["mean"] for c in s["channels"][:3]] for s in (before, state)])
    sds = np.array([c["sd"] for c in state["channels"][:3]]) / np.sqrt(150)
    # 600 samples were averaged, and at least 150 since
    assert np.all(np.abs(means[1]) < 5.0 * sds)
    assert np.max(np.abs(means[0])) > 0.2, "before they were not"
    assert state["lost_packets"] == state["bad_checksums"] == state["discarded_bytes"] == 0
    assert any("zeroed" in event["text"] for event in state["events"])
    assert not any("no packets" in event["text"] for event in state["events"]), state["events"]
    path = connection.record()
    wait_until(lambda: connection.snapshot(2**62)["recording"]["samples"] > 60)
    live = connection.stop_recording()
    assert live["log"] == path
    if filtered != "none":
        assert untimed(live) == replayed(path, code=1)
        assert live["gaps"] == []
    assert np.max(np.diff(reader.read(Path(path)).seconds())) < 0.1, "nothing of before is in it, and nothing lacks"
    connection.stop()


def test_an_acquisition_that_ends_does_not_wait_for_the_unit_to_zero(start: Start) -> None:
    connection = start(record=False, rate_hz=20.0, filter="none")
    told: list[str] = []

    def zero() -> None:
        with pytest.raises(SessionError) as caught:
            connection.zero(255)
        told.append(str(caught.value))

    thread = threading.Thread(target=zero)
    thread.start()
    wait_until(lambda: bool(connection.snapshot(2**62)["zeroing"]))
    connection.stop()
    thread.join(LIMIT_S)
    assert "ended" in told[0]


def test_the_filter_takes_another_reference_and_effects_between_recordings(start: Start) -> None:
    connection = start(rate_hz=50.0)
    with pytest.raises(SessionError, match="finish the recording first: r"):
        connection.configure(reference="gravity")
    connection.stop_recording()
    before = connection.snapshot(2**62)
    for changes, words in (
        ({"reference": "profile"}, "motion"),
        ({"reference": "sideways"}, "not one of"),
        ({"reference_file": ("t.toml", "segment = 3")}, "t.toml is no table profile"),
        ({"effects": "version = 7"}, "version"),
        ({"effects": EFFECTS.replace("thermal_lin", "gremlins")}, "gremlins"),
        ({"rate_hz": 5.0}, "changes: `rate_hz` is unknown; known: reference"),
    ):
        with pytest.raises(SessionError, match=words):
            connection.configure(**changes)
    after = connection.snapshot(2**62)
    assert (after["reference"], after["effects"]) == (before["reference"], before["effects"])
    assert after["packets"] >= before["packets"], "and the filter did not begin anew"
    connection.configure(reference_file=("tumble.TOML", PROFILE), effects=EFFECTS)
    state = connection.snapshot(2**62)
    assert state["reference"] == {"name": "profile", "file": "tumble.TOML", "profile": True}
    assert state["effects"] == ["gy thermal_lin"]
    path = connection.record()
    connection.mark("segment 1")
    wait_until(lambda: connection.snapshot(2**62)["recording"]["samples"] > 80)
    # a busy machine may still load what filters
    wait_until(lambda: connection.snapshot(2**62)["filter"]["effects"])
    (effect,) = connection.snapshot(2**62)["filter"]["effects"]
    assert effect["name"] == "gy thermal_lin k (deg/s/K)"
    live = connection.stop_recording()
    assert live["reference"] == "profile"
    assert len(live["effects"]) == 1
    assert untimed(live) == replayed(path, code=1)
    # a profile that is found in the whole log: recorded with it and without a filter, which is back with level
    connection.configure(reference_file=("t.toml", "# turn it\n" + PROFILE.replace("marks", "gyro")))
    state = connection.snapshot(2**62)
    assert (state["filter"], state["reference"]["profile"]) == (None, True)
    assert connection.profile()["about"] == ["turn it"]
    connection.configure(reference="level", effects="")
    state = connection.snapshot(2**62)
    assert state["reference"] == {"name": "level", "file": "", "profile": False}
    assert state["filter"]["filter"] == "spkf"
    assert state["effects"] == []
    assert connection.profile() is None
    connection.stop()


def test_effects_need_the_filter_that_takes_them(watched: client.Client) -> None:
    with pytest.raises(SessionError, match=r'"spkf" only.*--effects'):
        watched.configure(effects=EFFECTS)
    assert watched.snapshot(2**62)["effects"] == []


def test_the_guide_leads_through_a_profile_and_every_viewer_sees_it(start: Start) -> None:
    connection = start(record=False, rate_hz=20.0)
    with pytest.raises(SessionError, match="load one as the reference first"):
        connection.guide("begin")
    with pytest.raises(SessionError, match="begin one first"):
        connection.guide("next")
    connection.configure(reference_file=("tumble.toml", PROFILE))
    profile = connection.profile()
    assert profile is not None
    assert [one["text"] for one in profile["segments"]] == [
        "go to outer 0°, middle 0°, inner 0°",
        "go to outer 0°, middle 0°, inner 90°",
    ]
    connection.guide("begin")
    other = client.attach()
    assert other.snapshot(2**62)["guide"]["state"] == "go"
    path = other.snapshot(2**62)["recording"]["path"]
    connection.guide("next")
    state = other.snapshot(2**62)["guide"]
    assert (state["state"], state["segment"], state["count"]) == ("hold", 0, 2)
    with pytest.raises(SessionError, match="wait, or cancel"):
        other.guide("next")
    connection.mark("door closed")
    wait_until(lambda: connection.snapshot(2**62)["guide"]["segment"] == 1)
    other.guide("next")
    other.guide("cancel")
    other.guide("resume")
    assert connection.snapshot(2**62)["guide"]["segment"] == 1
    marks = connection.snapshot(2**62)["marks"]
    assert [mark["text"] for mark in marks] == ["segment 1", "door closed", "segment 2", "segment 2 ends"]
    assert all(mark["t"] >= 0.0 for mark in marks)
    live = connection.stop_recording()
    assert connection.snapshot(2**62)["guide"]["state"] == "cancelled"
    with pytest.raises(SessionError, match="begin again"):
        connection.guide("resume")
    connection.stop()
    log = reader.read(Path(path))
    # what was said beside begins no segment
    assert [(e.name, e.text) for e in log.events if e.name != "acquisition"] == [
        ("mark", "segment 1"),
        ("remark", "door closed"),
        ("mark", "segment 2"),
        ("mark", "segment 2 ends"),
    ]
    assert untimed(live) == replayed(path, code=1)


def test_a_guided_recording_is_as_wished_and_the_next_can_be_level_again(start: Start) -> None:
    connection = start(record=False, rate_hz=20.0, filter="none")
    connection.configure(reference_file=("tumble.toml", PROFILE))
    with pytest.raises(InputError, match="rotate_minutes"):
        connection.guide("begin", RecordingWish(rotate_minutes=-1.0))
    assert connection.snapshot(2**62)["guide"] is None
    connection.guide("begin", RecordingWish("cold 1", "ana", "lab 2", "AC-120"))
    wait_until(lambda: connection.snapshot(2**62)["recording"]["samples"] > 0)
    guided = reader.read(Path(connection.stop_recording()["log"]))
    info = guided.info
    assert (info.note, info.operator, info.place, info.table) == ("cold 1", "ana", "lab 2", "AC-120")
    assert info.reference == "profile"
    connection.configure(reference="level", reference_file=("", ""))
    state = connection.snapshot(2**62)
    assert (state["reference"], state["guide"]) == ({"name": "level", "file": "", "profile": False}, None)
    connection.record()
    wait_until(lambda: connection.snapshot(2**62)["recording"]["samples"] > 0)
    level = reader.read(Path(connection.stop_recording()["log"]))
    assert (level.info.reference, level.info.reference_sha256) == ("level", "")
    connection.stop()


def test_a_port_that_an_acquisition_has_is_not_probed(watched: client.Client) -> None:
    before = watched.snapshot(2**62)
    found = client.probe(before["port"])
    assert not found["answers"]
    assert 'in use by the acquisition "default"' in found["error"]
    assert watched.snapshot(2**62)["lost_packets"] == before["lost_packets"]


def test_status_tells_room_parts_reference_and_guide(start: Start) -> None:
    connection = start(rate_hz=20.0, rotate_minutes=1.5 / 60.0, filter="none")
    wait_until(lambda: connection.snapshot(2**62)["recording"]["part"] > 1)
    text = imutui("status").stdout
    for words in (
        "free ",
        " GB",
        "of the recording",
        "another file after 0.025 minutes",
        "reference level, no effects",
    ):
        assert words in text
    connection.stop_recording()
    connection.configure(reference_file=("tumble.toml", PROFILE))
    connection.guide("begin")
    text = imutui("status").stdout
    assert "reference profile from tumble.toml" in text
    assert "guide: waiting for the operator at segment 1 of 2" in text
    assert imutui_json("status")[0]["guide"]["state"] == "go"
    events = [event["text"] for event in connection.snapshot(2**62)["events"]]
    assert any("stays in one file" in event for event in events)
    connection.stop()


def test_an_event_is_written_behind_packets_that_still_wait(tmp_path: Path) -> None:
    """On a busy machine they wait for longer than a block; without any that wait, a second after the last is now."""
    second = 10**9
    acquisition = unread(Plan("virtual", filter="none", logs=str(tmp_path)), SessionInfo(filter="none"))
    packet = Packet(Mode.SCALED, (0, 0, 0), (0, 0, 5461), 1550, 0)
    acquisition.take(block_of(packet, Stamp(10 * second, False), 10 * second))
    for read_s, now_s, written_s in ((10.0, 10.2, 10.0), (10.0, 12.0, 12.0), (11.9, 12.0, 10.0), (11.9, 16.0, 16.0)):
        acquisition.reader.last_packet_ns = round(read_s * second)
        assert acquisition._second(round(now_s * second)).written_ns == round(written_s * second)
