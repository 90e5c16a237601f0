"""Where in a profile readings depart from the model: position, channel, size, and what that speaks against."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.filtering import dwell, filtered

from filters import simulation
from filters.kalman.runner import Estimator
from filters.kalman.settings import Settings
from filters.motion.profile import Profile
from filters.motion.segments import Dwell, Rate
from filters.simulation import Effect
from imutui.logbook import departures
from imutui.logbook.session_info import SessionInfo

HZ = 20.0


def rest(outer: float, middle: float, inner: float = 0.0) -> Dwell:
    return dwell(outer, middle, inner, 16.0)


def spin(dps: float) -> Rate:
    return Rate("inner", np.deg2rad(dps), 12.0)


POSITIONS = Profile((rest(0, 0), rest(0, 90), rest(0, -90)))
SPINS = Profile((rest(0, 0), spin(60), rest(0, 0, 720), spin(-60), rest(0, 0)), offset_sd=0.005)


def run(believed: Profile, true: Profile | None = None, effects: tuple[Effect, ...] = ()) -> Estimator:
    """The filter with a profile, over readings of a table that went through `true`."""
    motion = true or believed
    samples, _ = simulation.simulate(motion, rate_hz=HZ, seconds=believed.duration, seed=3, effects=effects)
    return filtered(Settings(1.0 / HZ, reference="profile", motion=believed), samples, every=np.inf)[0]


def said(estimator: Estimator, **info: object) -> str:
    """The sentence, in the axes of an instrument."""
    session = replace(SessionInfo(), **info)  # type: ignore[arg-type]
    return departures.sentence(estimator, session) or ""


def test_a_good_unit_on_its_profile_departs_nowhere() -> None:
    assert run(POSITIONS).departure() is None
    assert Estimator(Settings(1.0 / HZ)).departure() is None


@pytest.mark.parametrize(
    ("profile", "channel", "what", "against"),
    [
        (POSITIONS, "ax", "mg", "the unit, since no angle of the table changes the length of gravity"),
        (SPINS, "gz", "deg/s", "the unit, or the table's rate is off by as much"),
    ],
)
def test_a_scale_factor_of_one_per_cent_is_named_with_position_channel_and_size(
    profile: Profile, channel: str, what: str, against: str
) -> None:
    estimator = run(profile, effects=(Effect("scale", (channel,), {"relative": 0.01}),))
    found = said(estimator)
    assert found.startswith("segment ")
    assert f": {channel} reads " in found
    assert f" {what} " in found
    share = float(found.partition("scale factor of ")[2].partition(" %")[0])
    assert share == pytest.approx(1.0, abs=0.15)
    assert found.endswith(f"It speaks against {against}")
    assert not any("belong together" in alarm for alarm in estimator.alarms())


def test_a_position_that_was_not_gone_to_is_the_tables_and_another_one_the_profiles() -> None:
    """Two degrees of tilt leave gravity its length; ninety are no effect of a unit, and an alarm too."""
    tilted = run(POSITIONS, Profile((rest(0, 0), rest(2, 90), rest(0, -90))))
    assert "tilt of" in said(tilted)
    assert "against the table or the mounting" in said(tilted)
    elsewhere = run(POSITIONS, Profile((rest(0, 0), rest(90, 0), rest(0, -90))))
    assert "against the profile, the mounting or the sign, not the unit" in said(elsewhere)
    assert any("belong together" in alarm for alarm in elsewhere.alarms())
    turned = run(
        SPINS,
        Profile((rest(0, 0), spin(-60), rest(0, 0, -720), spin(60), rest(0, 0)), offset_sd=0.005),
    )
    assert "gz reads" in said(turned)
    assert "not the rate that it says" in said(turned)


def test_the_sentence_is_in_the_instruments_own_axes() -> None:
    estimator = run(POSITIONS, effects=(Effect("scale", ("ax",), {"relative": 0.01}),))
    straight, mounted = said(estimator), said(estimator, mount="y,x,-z")
    assert ": ax reads" in straight
    assert ": ay reads" in mounted
    assert straight.partition("scale")[2] == mounted.partition("scale")[2]
