"""How soon a unit that was reset in mid-stream is asked again, and sends again: virtual units of both kinds on a pty.

    python benchmarks/resets.py [--times 48] [--seed 5]

Each acquisition's unit is reset once, at a moment drawn from the seed. "Quiet" is an IMU381 that sends nothing from
power-up on; the other one streams by itself, and is known by its counter.
"""

import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import bench
import numpy as np
from helpers.faulty_lines import FaultyLine, LineFault
from helpers.units import Still, served

from imutui.instrument.imu400.unit import UnitOptions, VirtualUnit
from imutui.instrument.port import Port
from imutui.instrument.registry import INSTRUMENTS
from imutui.instrument.uut import unit as uut
from imutui.instrument.uut.fields import Field
from imutui.instrument.uut.unit_options import UnitOptions as UutOptions
from imutui.session import observe
from imutui.session.engine import Engine
from imutui.session.plan import Plan

CASES = (("imu400cd", 133.0), ("imu400cd", 0.1), ("imu381 quiet", 100.0), ("imu381 quiet", 4.0), ("imu381", 100.0))
LIMIT_S = 10.0


def unit(kind: str, seed: int) -> Any:
    """A unit that has just been switched on."""
    if kind == "imu400cd":
        return VirtualUnit(Still(), UnitOptions(serial_number=7), seed)
    fields = dict(UutOptions().fields) | ({Field.RATE_DIVIDER: 0} if kind.endswith("quiet") else {})
    options = UutOptions(serial_number=7, fields=tuple(fields.items()))
    return uut.VirtualUnit(Still(), options, seed)


def once(kind: str, rate_hz: float, at_s: float, seed: int) -> tuple[float, float]:
    """Seconds from the reset until the unit is asked, and until its packets are used again; NaN where it is not."""
    made, name = unit(kind, seed), kind.partition(" ")[0]
    reset_at, wake = list[float](), made._wake

    def noted(*ready: float) -> None:
        reset_at.append(time.monotonic())
        wake(*ready)

    made._wake = noted
    it, line = INSTRUMENTS[name], FaultyLine((LineFault(at_s, "reset"),))
    baud, asked = it.power_up_bauds[0], float("nan")
    with tempfile.TemporaryDirectory() as folder, served(made, line=line) as device, Port(device, baud) as port:
        host = it(port, rate_hz)
        plan = Plan(device, rate_hz=rate_hz, logs=folder, filter="none", instrument=name, accel_sign=it.accel_sign)
        engine = Engine(plan, host, host.open(baud))
        engine.start()
        try:
            while not reset_at or time.monotonic() - reset_at[0] < LIMIT_S:
                time.sleep(0.005)
                is_away = (
                    engine.call(lambda acquisition: observe.snapshot(acquisition, 2**62))["reconnecting"] is not None
                )
                if reset_at and is_away and np.isnan(asked):
                    asked = time.monotonic() - reset_at[0]
                if not is_away and not np.isnan(asked):
                    return asked, time.monotonic() - reset_at[0]
            return asked, float("nan")
        finally:
            engine.request_stop()
            engine.lifecycle.ended.wait(30.0)


def main() -> None:
    options = bench.options(__doc__, times=48, seed=5)
    print(bench.describe("numpy", "pyserial"), flush=True)
    columns = ("asked, s: median, max", "within 1 s", "not known", "sends again, s: median, max")
    bench.head("unit, Hz", "resets", *columns)
    for kind, rate_hz in CASES:
        at_s = 2.0 + np.random.default_rng(options.seed).uniform(0.0, 1.0, options.times)
        with ThreadPoolExecutor(4) as pool:
            found = np.array(list(pool.map(lambda k: once(kind, rate_hz, at_s[k], k), range(options.times))))  # noqa: B023
        known = found[~np.isnan(found).any(axis=1)]
        (asked, back), (last, latest) = np.median(known, axis=0), known.max(axis=0)
        counts = np.sum(known[:, 0] <= 1.0), options.times - len(known)
        bench.row(
            f"{kind}, {rate_hz:g}", options.times, f"{asked:.2f}, {last:.2f}", *counts, f"{back:.2f}, {latest:.2f}"
        )


if __name__ == "__main__":
    main()
