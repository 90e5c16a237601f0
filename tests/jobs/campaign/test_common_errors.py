"""What units of a batch show together is told as such, and nothing where there is nothing."""

from pathlib import Path

import numpy as np
from helpers import batches
from helpers.batches import Error, along

from filters.types import Array
from imutui.jobs.campaign import common_errors, unit_at_rest
from imutui.jobs.campaign.common_errors import CommonField
from imutui.jobs.campaign.unit_at_rest import UnitAtRest


def units(folder: Path, **how: object) -> list[UnitAtRest]:
    """Units of a batch, as they are compared, by the second."""
    folder.mkdir()
    logs = batches.batch(folder, **how)  # type: ignore[arg-type]
    assert unit_at_rest.row_period(logs) == 1.0
    found = [unit_at_rest.unit_at_rest(f"U{k + 1}", [log], 1.0) for k, log in enumerate(logs)]
    return [unit for unit in found if unit is not None]


def shown(folder: Path, **how: object) -> list[CommonField]:
    return common_errors.found_in(units(folder, **how), 1.0)


def step(t: Array) -> Array:
    """The table leans by 0.7 deg after a minute, and back after another half."""
    return along(3, 0.12 * ((t > 60.0) & (t < 90.0)))


def constant(axis: int, size: float) -> Error:
    return lambda t: along(axis, np.full(t.size, size))


def walk(t: Array) -> Array:
    return along(5, 1.5e-3 * np.cumsum(np.random.default_rng(3).normal(size=t.size)))


def tone(t: Array) -> Array:
    return along(3, 0.05 * np.sin(2.0 * np.pi * 4.3 * t))


def test_a_step_of_the_table_is_told_with_its_time_and_tilt(tmp_path: Path) -> None:
    for count in (4, 8):  # more than six are compared in groups
        (one,) = shown(tmp_path / str(count), count=count, common=step)
        assert (one["kind"], len(one["units"])) == ("event", count)
        assert (one["start_utc"], one["end_utc"]) == ("2026-11-21T10:31:00.000Z", "2026-11-21T10:31:30.000Z")
        (size,) = one["sizes"]
        assert size["axis"] == "fx"
        assert abs(size["value"] - 12.2) < 1.5
        assert one["tilt_deg"] is not None
        assert abs(one["tilt_deg"][1] + 0.7) < 0.1


def test_drift_and_tone_are_told(tmp_path: Path) -> None:
    (drift,) = shown(tmp_path / "drift", seconds=300.0, common=walk)
    assert (drift["kind"], drift["sizes"][0]["axis"], drift["follows_temperature"]) == ("drift", "fz", False)
    (line,) = shown(tmp_path / "tone", common=tone)
    assert (line["kind"], line["sizes"][0]["axis"], line["in_step"]) == ("tone", "fx", True)
    assert line["hz"] is not None
    assert abs(line["hz"] - 4.3) < 0.01


def test_a_tone_that_keeps_no_phase_is_in_the_units(tmp_path: Path) -> None:
    def wandering(seed: int) -> Error:
        def made(t: Array) -> Array:
            phase = np.cumsum(np.random.default_rng(seed).normal(scale=0.05, size=t.size))
            return along(3, 0.15 * np.sin(2.0 * np.pi * 4.3 * t + phase))

        return made

    found = shown(tmp_path / "own", own={k: wandering(k) for k in range(4)})
    assert [one["in_step"] for one in found if one["kind"] == "tone"] in ([], [False])


def test_a_tilt_is_told_though_one_unit_is_bad(tmp_path: Path) -> None:
    """Of units that are mounted alike it is said that a bias of all would look the same."""
    for name, mounts in (("alike", ("x,y,z",)), ("turned", ("x,y,z", "-x,-y,z"))):
        (one,) = shown(tmp_path / name, common=constant(4, 0.5), own={2: constant(4, 0.6)}, mounts=mounts)
        assert (one["kind"], one["told_apart"]) == ("tilt", len(mounts) > 1)
        assert one["tilt_deg"] is not None
        assert abs(one["tilt_deg"][0] - 2.9) < 0.8


def test_a_bias_of_all_units_of_a_model_is_no_tilt_where_mountings_tell(tmp_path: Path) -> None:
    def turned(k: int) -> Error:
        return constant(4, 0.5 if k % 2 else -0.5)

    assert not shown(tmp_path / "model", own={k: turned(k) for k in range(4)}, mounts=("x,y,z", "-x,-y,z"))


def test_what_one_unit_does_is_not_common_and_is_seen_beside_what_is(tmp_path: Path) -> None:
    own = {1: lambda t: along(4, 0.12 * (t > 40.0))}
    assert not shown(tmp_path / "alone", own=own)
    both = units(tmp_path / "both", common=step, own=own)
    assert [one["sizes"][0]["axis"] for one in common_errors.found_in(both, 1.0)] == ["fx"]
    assert common_errors.by_themselves(both) == {"U2": ["fy"]}


def test_no_common_error_is_told_where_there_is_none(tmp_path: Path) -> None:
    """Over thirty batches; at `FALSE` for each of three kinds two of them would be a chance of one in 250."""
    told = [shown(tmp_path / str(seed), seed=100 + seed, count=3 + seed % 5) for seed in range(30)]
    assert sum(map(len, told)) <= 1
