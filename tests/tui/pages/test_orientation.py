"""How the unit lies, from gravity."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imutui.tui.pages.live.orientation import axes_in_space, drawn, tilt
from imutui.tui.terminal.glyphs import GLYPHS


@pytest.mark.parametrize(("roll", "pitch"), [(0.0, 0.0), (30.0, -20.0), (-170.0, 60.0), (90.0, 0.0), (0.0, 89.0)])
def test_roll_and_pitch_are_those_of_the_attitude(roll: float, pitch: float) -> None:
    attitude = Rotation.from_euler("ZYX", [123.0, pitch, roll], degrees=True)
    seen = tilt(attitude.inv().apply([0.0, 0.0, 1000.0]))
    assert seen is not None
    assert (seen.roll_deg, seen.pitch_deg) == pytest.approx((roll, pitch), abs=1e-6)
    northward = Rotation.from_euler("ZYX", [0.0, pitch, roll], degrees=True).as_matrix()
    np.testing.assert_allclose(axes_in_space(seen), northward.T, atol=1e-9)


def test_what_is_not_gravity_alone_is_no_attitude() -> None:
    assert tilt(np.zeros(3)) is None
    turned = tilt(np.array([0.0, 0.0, 1400.0]))
    assert turned is not None
    assert not turned.is_still


@pytest.mark.parametrize("glyphs", list(GLYPHS.values()))
def test_each_axis_has_its_name(glyphs: object) -> None:
    seen = tilt(np.array([0.0, 0.0, 1000.0]))
    assert seen is not None
    lines = drawn(seen, 9, 36, glyphs)  # type: ignore[arg-type]
    assert {len(line) for line in lines} == {36}
    assert {"x", "y", "z"} <= set("".join(lines))
    rows = {name: next(k for k, line in enumerate(lines) if name in line) for name in "xyz"}
    assert rows["z"] > rows["y"] > rows["x"]
