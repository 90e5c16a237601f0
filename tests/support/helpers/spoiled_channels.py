"""Readings of a simulated unit at rest, and thirty ways to spoil one of its channels."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from filters.channels import CHANNELS, DPS, MG
from filters.health.finding import HealthFinding
from filters.health.monitor import Expected, HealthMonitor
from filters.simulation.scenario import Scenario
from filters.simulation.unit import Unit
from filters.specification import ImuSpec, of_model
from imutui.instrument.registry import INSTRUMENTS
from imutui.logbook.health import Readings

SECONDS = 180.0


@dataclass(frozen=True)
class Made:
    """Readings in the instrument's axes and sign, SI, and what is known of the unit."""

    t: np.ndarray
    x: np.ndarray  # rates, then accelerations, shape (N, 6)
    degc: np.ndarray
    lsb: np.ndarray
    spec: ImuSpec

    @property
    def rate(self) -> float:
        return (self.t.size - 1) / float(self.t[-1] - self.t[0])


def healthy(instrument: str, rate: float, seed: int, seconds: float = SECONDS) -> Made:
    """Make readings of a unit whose noise is that of its data sheet, in whole counts."""
    of = INSTRUMENTS[instrument]
    spec, scaling = of_model(of.model), of.scaling(of.rate_range_dps, of.accel_range_g)
    unit = Unit(Scenario(seed=seed, spec=spec), rate_hz=rate)
    made, axes = unit.record(round(seconds * rate)), unit.scenario.axes
    x = np.hstack([axes.gyro_to_instrument(made.samples.gyro), axes.accel_to_instrument(made.samples.accel)])
    lsb = Readings(scaling, 9.80665).lsb
    degc = scaling.temperature_degc(scaling.temperature_counts(made.temperature_degc))
    return Made(made.samples.t, np.rint(x / lsb) * lsb, degc, lsb, spec)


def findings(made: Made, *, stated: bool = True, still: bool = True, chunk: int = 100) -> tuple[HealthFinding, ...]:
    """Findings of the monitor on readings that come in chunks; `stated`: whether counts and data sheet are known."""
    monitor = HealthMonitor(Expected(made.spec, made.lsb if stated else None, stated, still))
    for first in range(0, made.t.size, chunk):
        rows = slice(first, first + chunk)
        monitor.add(made.t[rows], made.x[rows, :3], made.x[rows, 3:], made.degc[rows])
    return monitor.findings(final=True)


Spoil = Callable[[Made, int, np.random.Generator], Made]


def _one(change: Callable[[np.ndarray, Made, int, np.random.Generator], np.ndarray]) -> Spoil:
    """A change of one channel's readings."""

    def spoil(made: Made, c: int, rng: np.random.Generator) -> Made:
        x = made.x.copy()
        x[:, c] = np.rint(change(x[:, c].copy(), made, c, rng) / made.lsb[c]) * made.lsb[c]
        return replace(made, x=x)

    return spoil


def _set(x: np.ndarray, rows: object, value: object) -> np.ndarray:
    x[rows] = value  # type: ignore[index]
    return x


def _beside(made: Made, c: int, kind: int = 0) -> np.ndarray:
    """The next channel of the same kind, or the one along the same axis of the other kind."""
    return made.x[:, (c + 3) % 6] if kind else made.x[:, 3 * (c // 3) + (c + 1) % 3]


def _scaled(x: np.ndarray, other: np.ndarray, ratio: float) -> np.ndarray:
    return x.mean() + ratio * (other - other.mean()) * (x.std() / other.std())


def _repeated(made: Made, c: int, rng: np.random.Generator) -> Made:
    return replace(made, x=made.x[np.arange(made.t.size) // 4 * 4])


def _noisy_gyros(made: Made, c: int, rng: np.random.Generator) -> Made:
    x = made.x.copy()
    x[:, :3] += 10.0 * x[:, :3].std(axis=0) * rng.normal(size=(made.t.size, 3))
    return replace(made, x=x)


def _rad_per_s(made: Made, c: int, rng: np.random.Generator) -> Made:
    """All gyros in rad/s where deg/s are expected, not in whole counts."""
    x = made.x.copy()
    x[:, :3] *= DPS
    return replace(made, x=x)


def _temperature(value: Callable[[np.ndarray], np.ndarray]) -> Spoil:
    return lambda made, c, rng: replace(made, degc=value(made.degc.copy()))


def _every(made: Made, seconds: float) -> slice:
    step = round(seconds * made.rate)
    return slice(step // 2, None, step)


def _some(made: Made, rng: np.random.Generator, count: int = 18) -> np.ndarray:
    return rng.choice(made.t.size, count, replace=False)


TOLERANCE = (0.05 * DPS,) * 3 + (0.6 * MG,) * 3
KINDS: dict[str, tuple[str, Spoil]] = {
    "dead": ("dead", _one(lambda x, m, c, g: _set(x, slice(None), x[0]))),
    "dead at zero": ("dead", _one(lambda x, m, c, g: x * 0.0)),
    "dead at full scale": ("dead", _one(lambda x, m, c, g: x * 0.0 + 32767.0 * m.lsb[c])),
    "frozen after 60 s": ("frozen", _one(lambda x, m, c, g: _set(x, m.t > 60.0, x[np.argmax(m.t > 60.0)]))),
    "frozen for 5 s": ("frozen", _one(lambda x, m, c, g: _set(x, (m.t > 90.0) & (m.t < 95.0), x[0]))),
    "frozen three times": ("frozen", _one(lambda x, m, c, g: _set(x, m.t % 60.0 < 4.0, x[0]))),
    "copy": ("copy", _one(lambda x, m, c, g: _beside(m, c))),
    "copy of another kind": ("copy", _one(lambda x, m, c, g: _scaled(x, _beside(m, c, 1), 1.0))),
    "half a copy": ("copy", _one(lambda x, m, c, g: _scaled(x, _beside(m, c), 0.5))),
    "copy turned": ("copy", _one(lambda x, m, c, g: -_beside(m, c))),
    "copy one reading late": ("copy", _one(lambda x, m, c, g: np.roll(_beside(m, c), 1))),
    "copy after 60 s": ("copy", _one(lambda x, m, c, g: np.where(m.t > 60.0, _beside(m, c), x))),
    "step of 64 counts": ("coarse", _one(lambda x, m, c, g: np.rint(x / m.lsb[c] / 64) * 64 * m.lsb[c])),
    "step of 8 counts": ("coarse", _one(lambda x, m, c, g: np.rint(x / m.lsb[c] / 8) * 8 * m.lsb[c])),
    "zero each 10 s": ("invalid", _one(lambda x, m, c, g: _set(x, _every(m, 10.0), 0.0))),
    "zero each 3 s": ("invalid", _one(lambda x, m, c, g: _set(x, _every(m, 3.0), 0.0))),
    "full scale now and then": ("invalid", _one(lambda x, m, c, g: _set(x, _some(m, g), 32767 * m.lsb[c]))),
    "spikes of 15 sd": ("invalid", _one(lambda x, m, c, g: x + _set(x * 0, _some(m, g), 15.0 * x.std()))),
    "noise 10 times": ("noisy", _one(lambda x, m, c, g: x + g.normal(size=x.size) * 10.0 * x.std())),
    "noise 10 times in all gyros": ("noisy", _noisy_gyros),
    "noise 1/30": ("quiet", _one(lambda x, m, c, g: x.mean() + (x - x.mean()) / 30.0)),
    "gyros in rad/s": ("quiet", _rad_per_s),
    "clipped at its mean": ("clipped", _one(lambda x, m, c, g: np.minimum(x, np.median(x)))),
    "clipped at 1 sd": ("clipped", _one(lambda x, m, c, g: np.minimum(x, x.mean() + x.std()))),
    "clipped at -1.5 sd": ("clipped", _one(lambda x, m, c, g: np.maximum(x, x.mean() - 1.5 * x.std()))),
    "all repeated 4 times": ("repeated", _repeated),
    "repeated 4 times": ("repeated", _one(lambda x, m, c, g: x[np.arange(x.size) // 4 * 4])),
    "drift of six tolerances": ("moving", _one(lambda x, m, c, g: x + 6.0 * TOLERANCE[c] * m.t / m.t[-1])),
    "temperature 0": ("temperature", _temperature(lambda degc: degc * 0.0)),
    "temperature 1e6": ("temperature", _temperature(lambda degc: degc * 0.0 + 1e6)),
    "temperature jumps": ("temperature", _temperature(lambda degc: _set(degc, slice(1000, 1010), -40.0))),
}  # fmt: skip
"""Kind of finding that each way should give, and what makes it of readings, a channel's number and a generator."""


def channel_of(expected: str, c: int) -> str:
    """Name of the channel that a finding should name."""
    return "T" if expected == "temperature" else CHANNELS[c]
