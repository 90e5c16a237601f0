"""A small set of effects in the format of tests/undeclared/README.md, to test what runs such sets."""

import math
from collections.abc import Callable

import numpy as np

Error = Callable[..., tuple[float, ...]]

_LOOP_HZ = 400.0 / 3.0


def heating_root(seed: int) -> Error:
    """Grows with the root of how fast it is heated or cooled."""
    del seed
    last, kelvin_per_s = math.nan, 0.0

    def error(t: float, temp: float, ang: object, rate: object, w: object, f: object) -> tuple[float, ...]:
        nonlocal last, kelvin_per_s
        change = 0.0 if math.isnan(last) else (temp - last) * _LOOP_HZ
        kelvin_per_s += 0.01 * (change - kelvin_per_s)
        last = temp
        return 0.0, 0.5 * math.copysign(math.sqrt(abs(kelvin_per_s)), kelvin_per_s), 0.0, 0.0, 0.0, 0.0

    return error


def supply(seed: int) -> Error:
    """A supply voltage that wanders, on two channels."""
    rng = np.random.default_rng(seed)
    phase, period = rng.uniform(0.0, 6.0), rng.uniform(50.0, 80.0)

    def error(t: float, temp: float, ang: object, rate: object, w: object, f: object) -> tuple[float, ...]:
        volts = math.sin(2.0 * math.pi * t / period + phase + 0.8 * math.sin(t / 29.0 + phase))
        return 0.0, 0.0, 0.3 * volts, 0.005 * volts, 0.0, 0.0

    return error


def faint(seed: int) -> Error:
    del seed
    return lambda t, temp, ang, rate, w, f: (0.0, 0.0, 0.0, 0.0, 1e-5 * temp, 0.0)


_COMMON = {"noise": "simulated", "motion": "still"}
EFFECTS = {
    "heating_root": {
        "title": "An error with the root of the heating rate", "channels": ["gy"], "driver": ["temperature_rate"],
        "in_log": True, "memory": True, "d": 60, **_COMMON,
    },
    "supply": {
        "title": "A supply voltage that wanders", "channels": ["gz", "ax"], "driver": ["hidden"],
        "in_log": False, "memory": False, "d": 80, **_COMMON,
    },
    "faint": {
        "title": "Too weak to see", "channels": ["ay"], "driver": ["temperature"],
        "in_log": True, "memory": False, "d": "too weak to see", **_COMMON,
    },
}  # fmt: skip
