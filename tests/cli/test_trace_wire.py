"""From the wire to the cause: units on pseudo terminals, acquired, logged, and traced from the logs alone."""

import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from helpers import ros_messages
from helpers.commands import imutui_json
from helpers.documents import toml
from helpers.places import own_places
from helpers.shared import once
from unit_time import SLOW_LINE, acquire

from imutui.instrument.imu400.crossbow import TICK_S
from imutui.logbook import reader

# three power-ons that heat and cool at different times; the last is held out, and lasts long enough for a verdict
SCENARIO = toml(
    seed=23,
    biases={"accel_mg": [5.0, -3.0, 8.0], "gyro_dps": [0.5, -0.2, 0.1]},
    effect=[
        {"name": "thermal_lin", "channel": "gy", "dps_per_k": 0.1},
        {"name": "spikes", "channel": "ay", "mg": 3000.0, "per_hour": 300.0},
    ],
    power_on=[
        {"seed": seed, "temperature": {"history": history}}
        for seed, history in (
            (1, [[0.0, 20.0], [50.0, 40.0], [110.0, 24.0]]),
            (2, [[0.0, 38.0], [30.0, 38.0], [80.0, 20.0], [115.0, 34.0]]),
            (3, [[0.0, 26.0], [90.0, 22.0], [200.0, 40.0], [305.0, 25.0]]),
        )
    ],
)
SECONDS = (115.0, 115.0, 305.0)


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """The three power-ons over the wire, two at a time."""
    names = ("cold", "warm", "check")

    def make(folder: Path) -> None:
        scenario = folder / "unit.toml"
        scenario.write_text(SCENARIO)
        with pytest.MonkeyPatch.context() as patch, ThreadPoolExecutor(2) as pool:
            own_places(patch, folder)

            def one(n: int) -> None:
                done = acquire(scenario, n, folder / f"{names[n]}.mcap", SECONDS[n], *SLOW_LINE)
                assert "ay invalid" in done.stderr + done.stdout
                assert done.returncode == 1

            # the longest first
            list(pool.map(one, (2, 0, 1)))

    folder = once(tmp_path_factory, "wire", make)
    return [folder / f"{name}.mcap" for name in names]


def test_a_log_is_on_the_unit_s_time(logs: list[Path]) -> None:
    """However fast it was acquired: 20 Hz, nothing lost, and the temperature as the scenario has it."""
    for path, seconds in zip(logs, SECONDS, strict=True):
        log = reader.read(path, raw=True)
        ms = np.mod(-np.diff([packet.ticks for packet in ros_messages.packets(log)]), 65536) * TICK_S * 1e3
        assert ms.max() < 23.0, "by the unit's own counter every second or third reading was sent, and none is missing"
        t = log.seconds()
        assert t[-1] == pytest.approx(seconds, abs=0.5)
        # a sample is the mean of the two or three packets of its 50 ms, and the clock corrects itself by up to 2 ms
        assert np.diff(t) == pytest.approx(0.05, abs=0.0225)
        assert t.size == pytest.approx(20.0 * seconds, abs=10)
        assert log.info.kind == "simulated"
    peak = reader.read(logs[0])
    assert peak.seconds()[np.argmax(peak.samples.degc)] == pytest.approx(50.0, abs=1.5)


def test_the_cause_is_found_and_joins_the_filter(home: Path, logs: list[Path]) -> None:
    """Right channel, right cause, held-out error at the floor; with it the bias is one and the same, live as well."""
    result = imutui_json("trace", *logs, "-o", "effects.toml")
    assert [(f["effect"], f["channels"]) for f in result["findings"]] == [("thermal_lin", ["gy"])]
    assert result["findings"][0]["params"][0]["value"] == pytest.approx(0.1, abs=0.005)
    assert result["status"]["gy"] == "explained"
    assert ("spikes", ["ay"]) in [(f["effect"], f["channels"]) for f in result["integrity"]]
    error = next(e for e in result["error"] if (e["metric"], e["channel"]) == ("e10", "gy"))
    assert error["before_x_floor"] > 3.0
    assert error["after_x_floor"] < 1.3
    assert {result["status"][channel] for channel in ("gx", "gz", "ax", "az")} == {"clean"}

    # every power-on has the same bias, and begins at a temperature of its own: without the effect each has another
    without, joined = (_biases(logs, effects, "--end", "40") for effects in ("none", "effects.toml"))
    assert np.ptp(without) > 0.5
    assert np.ptp(joined) < 0.1

    live = acquire(
        logs[0].parent / "unit.toml", 1, home / "live.mcap", 62.0,
        *SLOW_LINE, "--filter", "spkf", "--effects", "effects.toml", "--json",
    )  # fmt: skip
    now = float(json.loads(live.stdout)["final"]["gyro_bias_dps"][1])
    assert now == pytest.approx(float(np.mean(joined)), abs=0.15)
    assert _biases([home / "live.mcap"]) == [pytest.approx(now, abs=1e-12)]
    assert abs(_biases([home / "live.mcap"], "none")[0] - now) > 0.3


def _biases(logs: list[Path], effects: str | None = None, *options: str) -> list[float]:
    """Of gy at the end of each, by one replay of all."""
    options += () if effects is None else ("--effects", effects)
    replayed = imutui_json("replay", *logs, *options, check=None)
    documents = replayed if isinstance(replayed, list) else [replayed]
    return [float(document["final"]["gyro_bias_dps"][1]) for document in documents]
