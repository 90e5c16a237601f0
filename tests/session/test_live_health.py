"""A channel that freezes while it is recorded: the fault is the same on every way out of the acquisition."""

from pathlib import Path

import unit_time
from helpers.acquisitions import replayed, untimed
from helpers.commands import imutui, imutui_json
from helpers.documents import toml
from helpers.processes import LIMIT_S, command_line, started, wait_until

from imutui.estimates import live_biases
from imutui.logbook import reader
from imutui.session import client

_FREEZES = {"name": "stuck", "channel": "gy", "at_s": 4.0, "seconds": 1e5}


def test_a_channel_that_freezes_is_red_on_every_way_out_and_in_the_replay(home: Path) -> None:
    (home / "unit.toml").write_text(toml(seed=3, temperature={"constant_degc": 25.0}, effect=[_FREEZES]))
    with (
        unit_time.virtual_in_real_time("--scenario", str(home / "unit.toml")) as (port, _),
        started(command_line("record", "--port", port, "--name", "unit", "-o", "a.mcap")) as record,
    ):
        assert record.stderr is not None
        assert "recording to" in record.stderr.readline()
        acquisition = client.attach("unit")
        wait_until(lambda: acquisition.snapshot(2**62)["health"] != [])
        wait_until(lambda: bool((acquisition.snapshot(2**62)["filter"] or {}).get("samples")))
        seen = acquisition.snapshot(2**62)
        said, (status,) = imutui("status").stdout, imutui_json("status")
        stopped = imutui_json("stop", check=1)
        printed, _ = record.communicate(timeout=LIMIT_S)

    (entry,) = seen["health"]
    assert (entry["channel"], entry["kind"], entry["level"]) == ("gy", "frozen", "bad")
    assert seen["filter"] is not None
    assert [one.name for one in live_biases(seen["filter"]) if (one.sd, one.converged_s) == (None, None)] == ["y gyro"]

    assert f"RED: {entry['said']}" in " ".join(said.split())
    assert status["health"] == [entry]

    assert record.returncode == 1
    assert printed.startswith("RED, gy frozen: ")
    assert stopped["health"] == [entry]
    assert (stopped["sd"]["gyro_bias_dps"][1], stopped["converged_s"]["gyro_bias"][1]) == (None, None)
    assert not stopped["converged"]

    events = [event.text for event in reader.read(home / "a.mcap").events if event.name == "health"]
    assert events == [entry["said"]]
    assert untimed(stopped) == replayed(home / "a.mcap", code=1)
