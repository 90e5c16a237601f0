import numpy as np

from filters import earth
from filters.state import PAPER_SITE


def test_gravity_at_the_papers_site_is_what_the_contract_says() -> None:
    assert abs(PAPER_SITE.gravity - 9.78637) < 5e-6


def test_gravity_meets_the_defining_values_at_equator_and_pole() -> None:
    """Somigliana's formula gives the tabulated 9.7803253359 and 9.8321849378 m/s² (NIMA TR8350.2, table 3.4)."""
    assert abs(earth.normal_gravity(np.array(0.0), np.array(0.0)) - 9.7803253359) < 1e-10
    assert abs(earth.normal_gravity(np.array(np.pi / 2), np.array(0.0)) - 9.8321849378) < 1e-9


def test_gravity_falls_by_the_free_air_gradient() -> None:
    low, high = (earth.normal_gravity(np.array(0.7), np.array(h)) for h in (0.0, 100.0))
    assert abs((low - high) / 100.0 - 3.086e-6) < 5e-9


def test_radii_are_those_of_the_ellipsoid() -> None:
    a, b = earth.SEMI_MAJOR_AXIS, earth.SEMI_MINOR_AXIS
    pole, equator = np.array(np.pi / 2), np.array(0.0)
    assert np.allclose(earth.curvature(pole, np.array(0.0)), a * a / b, rtol=1e-12)
    assert np.allclose(earth.curvature(equator, np.array(5.0)), [b * b / a + 5.0, a + 5.0], rtol=1e-12)


def test_earth_rate_points_north_and_up_in_the_north() -> None:
    rate = earth.earth_rate_n(np.array(np.deg2rad(30.0)))
    assert np.allclose(rate, earth.EARTH_RATE * np.array([np.sqrt(0.75), 0.0, -0.5]))
