"""Which virtual unit it is: its serial number."""

from pathlib import Path

import pytest

from imutui.cli.virtual_readings import Asked
from imutui.cli.virtual_units import SERIAL_NUMBER, UNITS


def serial_number(instrument: str, asked: Asked, given: int | None = None) -> int:
    return int(UNITS[instrument](asked, given).unit.options.serial_number)


@pytest.mark.parametrize("instrument", UNITS)
def test_the_seed_makes_the_serial_number_else_the_link_does(instrument: str, tmp_path: Path) -> None:
    """The same unit has the same number each time that it is asked for, and fits into the 32 bits of the line."""
    scenario = tmp_path / "warm.toml"
    scenario.write_text("seed = 7\n")
    of_seeds = [serial_number(instrument, Asked(seed=seed, link=Path("unit"))) for seed in (0, 1, 2)]
    assert of_seeds == [SERIAL_NUMBER, SERIAL_NUMBER + 1, SERIAL_NUMBER + 2]
    links = [Asked(link=Path(name)) for name in ("unit1", "unit2", "unit3", "/a/unit1", "/b/unit1")]
    of_links = [serial_number(instrument, asked) for asked in links]
    assert len({*of_links, *of_seeds}) == 8
    assert of_links == [serial_number(instrument, asked) for asked in links]
    # power-ons of one scenario are of one unit, at whatever link
    power_ons = [Asked(scenario, power_on=0, link=Path(f"unit{k}")) for k in range(2)]
    assert {serial_number(instrument, asked) for asked in power_ons} == {SERIAL_NUMBER + 7}
    assert serial_number(instrument, Asked()) == SERIAL_NUMBER
    assert serial_number(instrument, Asked(seed=5, link=Path("unit")), 42) == 42
    assert 0 <= serial_number(instrument, Asked(seed=2**32)) < 2**32
