"""Time that runs faster in a process, for trials with virtual instruments only.

`run_faster` makes the clocks of module `time` run so many times as fast as they do, and `time.sleep` as much shorter.
Waits of threads and of the operating system (locks, queues, select) take real time still. Two processes with the same
speed and beginning have the same monotonic clock, as they have without.
"""

import time
from collections.abc import Callable
from functools import partial

_speed, _since_ns = 1.0, 0
_monotonic_ns, _time_ns, _sleep = time.monotonic_ns, time.time_ns, time.sleep


def run_faster(speed: float, since_ns: int = 0) -> None:
    """Have time run so many times as fast, from a monotonic instant on, ns; from now on if it is zero."""
    global _speed, _since_ns
    _speed, _since_ns = speed, since_ns or _monotonic_ns()
    # the system's clock is that of the same instant, so that stamps of several processes belong together
    utc_ns = _time_ns() - _monotonic_ns()

    def monotonic_ns() -> int:
        return _since_ns + round((_monotonic_ns() - _since_ns) * speed)

    def time_ns() -> int:
        return utc_ns + monotonic_ns()

    clocks: dict[str, Callable[..., object]] = {
        "monotonic_ns": monotonic_ns,
        "monotonic": lambda: monotonic_ns() / 1e9,
        "time_ns": time_ns,
        "time": lambda: time_ns() / 1e9,
        "sleep": lambda seconds: _sleep(seconds / speed),
    }
    for name, clock in clocks.items():
        # no plain function: one that a class takes for its own (pyserial's `Timeout.TIME`) would become a method
        setattr(time, name, partial(clock))


def arguments() -> list[str]:
    """What a process that is started must be told to have the same time; nothing where time is as usual."""
    return [] if _speed == 1.0 else ["--speed", repr(_speed), "--since-ns", str(_since_ns)]
