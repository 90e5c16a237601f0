"""Channel health at the edge: what a session states of its unit, packets as readings, findings as JSON has them."""

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Protocol

import numpy as np

from filters import specification
from filters.channels import CHANNELS
from filters.health.finding import NO_BIAS, HealthEntry, HealthFinding
from filters.health.monitor import Expected
from imutui.logbook.session_info import SessionInfo

if TYPE_CHECKING:
    from filters.kalman.runner import Estimator


class Scaling(Protocol):
    """Scales of an instrument's counts."""

    def rates_dps(self, counts: np.ndarray, /) -> np.ndarray:
        """Angular rate, deg/s."""

    def accels_g(self, counts: np.ndarray, /) -> np.ndarray:
        """Acceleration, g."""

    def temperature_degc(self, counts: np.ndarray, /) -> np.ndarray:
        """Temperature, degC."""


_AT_REST = ("level", "gravity")


class Readings:
    """Turns counts of packets into readings in the instrument's own axes and sign.

    `scaling`: of the instrument, with `rates_dps`, `accels_g` and `temperature_degc`.
    `g_unit`: m/s² in a g.
    """

    def __init__(self, scaling: "Scaling", g_unit: float) -> None:
        self._scaling, self._g_unit = scaling, g_unit
        one = np.ones(3)
        self.lsb = np.concatenate([np.deg2rad(scaling.rates_dps(one)), scaling.accels_g(one) * g_unit])
        """Size of a count, rad/s and m/s², shape (6,)."""

    def of(self, counts: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rates (rad/s), accelerations (m/s²) and temperature (degC) of counts (N, 7)."""
        rates, accels = self._scaling.rates_dps(counts[:, :3]), self._scaling.accels_g(counts[:, 3:6])
        return np.deg2rad(rates), accels * self._g_unit, self._scaling.temperature_degc(counts[:, 6])


def expected(info: SessionInfo, lsb: np.ndarray | None) -> Expected:
    """Return what a session states of its unit.

    `lsb`: size of a count, rad/s and m/s², shape (6,); None for samples that no packets stand behind.
    """
    return Expected(
        spec=specification.of_model(info.instrument),
        lsb=lsb,
        stated=specification.is_known(info.instrument) and info.sampling != "foreign",
        still=info.reference in _AT_REST,
    )


def entries(findings: Iterable[HealthFinding]) -> list[HealthEntry]:
    """Return findings as JSON has them."""
    return [
        {"channel": f.channel, "kind": f.kind, "since_s": round(f.since_s, 3), "level": f.level, "said": f.said}
        for f in findings
    ]


def has_readings(health: Sequence[HealthEntry]) -> np.ndarray:
    """Whether each channel measures anything, accelerometers then gyros, instrument axes, bool, shape (6,)."""
    without = {entry["channel"] for entry in health if entry["kind"] in NO_BIAS}
    return np.array([name not in without for name in (*CHANNELS[3:], *CHANNELS[:3])])


def bias_sd(estimator: "Estimator | None", info: SessionInfo) -> np.ndarray | None:
    """Standard deviations of a filter's biases, gyros then accelerometers, instrument axes, SI, shape (6,).

    Returns None before the filter has any; NaN stands for a bias that it does not see.
    """
    if estimator is None or estimator.latest is None:
        return None
    from filters import state

    axes, sd = info.axes(), np.sqrt(np.diag(estimator.latest.belief.P))
    seen = np.array(estimator.observable).reshape(2, 3)
    of_axes = zip((state.GYRO_BIAS, state.ACCEL_BIAS), seen[::-1], strict=True)
    return np.concatenate([axes.sd_to_instrument(np.where(known, sd[part], np.nan)) for part, known in of_axes])
