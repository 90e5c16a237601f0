"""What of a unit turned by hand carries over to the next power-on, and how honest the spread to expect is.

    python benchmarks/carry_over.py [UNITS]

**Simulated.** Each unit has three power-ons to fit and one held out, each with 20 rests. Accelerometer biases differ
by 5 mg (1 sd), gyro biases by 0.2 deg/s, of every second unit scale factors of the accelerometers by 0.2 %. Printed:
how often each kind is said to be measured again; errors of what the effects file says of the held-out power-on over
their own standard deviations; errors at its rests before, after, and with what differs measured again.
"""

import sys
from collections import Counter, defaultdict
from dataclasses import replace

import bench  # noqa: F401 — makes the tests' helpers known
import numpy as np
from helpers.turned import ACCELEROMETERS, GYROS, TRUTH, turned_run

from filters.imu import STANDARD_GRAVITY
from filters.multiposition.calibration import calibrate
from filters.multiposition.report import report
from filters.tracing.run import Run
from filters.types import Array

_MG, _DPS = 1e-3 * STANDARD_GRAVITY, np.deg2rad(1.0)
_POWER_ONS = 4


def power_on(seed: int, rng: np.random.Generator, scale_sd: float) -> tuple[Run, Array, Array]:
    """A power-on, what its six biases (mg, deg/s) and its three scale factors are off from the unit's."""
    run = turned_run(*ACCELEROMETERS, *GYROS, seed=seed, rests=20)
    bias = rng.standard_normal(6) * np.repeat([0.2, 5.0], 3)
    scale = scale_sd * rng.standard_normal(3)
    reading = run.reading + bias * np.repeat([_DPS, _MG], 3)
    reading[:, 3:] += scale * run.reading[:, 3:]
    return replace(run, reading=reading), bias, scale


def main(units: int) -> None:
    """Print the tables."""
    said: dict[tuple[str, str], Counter[str]] = defaultdict(Counter)
    z: dict[str, list[float]] = defaultdict(list)
    errors = []
    for unit in range(units):
        rng, scale_sd = np.random.default_rng([unit, 7]), 2e-3 * (unit % 2)
        made = [power_on(10_000 + 10 * unit + k, rng, scale_sd) for k in range(_POWER_ONS)]
        trace = report(calibrate([run for run, *_ in made[:-1]], made[-1][0]), (), 0)
        _, bias, scale = made[-1]
        for e in trace.document["carries_over"]:
            differs = e["effect"] == "bias" or (
                e["effect"] == "scale" and e["channels"][0][0] == "a" and scale_sd > 0.0
            )
            kind = f"{e['effect']} {e['channels'][0][0]}"
            said[kind, "differs" if differs else "same"][str(e["measure_again"])] += 1
        for own in trace.included:
            channel = own.channels[0]
            c = ["gx", "gy", "gz", "ax", "ay", "az"].index(channel)
            off = bias[c] if own.effect == "bias" else scale[c - 3] if own.effect == "scale" and c > 2 else 0.0
            kind = f"{own.effect} {channel[0]}" + (", differs" if own.effect == "bias" or off else "")
            z[kind] += [(s.mean - t - off) / s.sd for s, t in zip(own.states, TRUTH[channel, own.effect], strict=True)]
        norm = next(e for e in trace.document["error"] if e["metric"] == "gravity_norm")
        errors.append([norm["before"], norm["after"], norm["after_again"] or np.nan, norm["floor"]])
    print("kind, truth: said to be measured again")
    for key, counts in sorted(said.items()):
        print(f"  {key[0]:16} {key[1]:8} " + ", ".join(f"{word} {n}" for word, n in sorted(counts.items())))
    print("error of the effects file at the held-out power-on over its standard deviation: rms, within 2, n")
    for kind, off_sd in sorted(z.items()):
        print(
            f"  {kind:24} {np.sqrt(np.mean(np.square(off_sd))):5.2f} {np.mean(np.abs(off_sd) < 2.0):5.2f} {len(off_sd)}"
        )
    median = np.nanmedian(np.array(errors), axis=0)
    print("magnitude of gravity, mg, median: before {:.3g}, after {:.2g}, again {:.2g}, floor {:.2g}".format(*median))


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 40)
