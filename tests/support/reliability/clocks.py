"""Somebody sets the computer's clock; and a replay is made again, at another speed."""

import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import patch

import numpy as np
from helpers.processes import wait_until
from helpers.units import Still, served
from mcap.reader import make_reader

from imutui.instrument.imu400.crossbow import POWER_UP_BAUD
from imutui.instrument.imu400.driver import Imu400cd
from imutui.instrument.imu400.unit import VirtualUnit
from imutui.instrument.port import Port
from imutui.jobs.replay import replay
from imutui.logbook import log_time, reader, schemas
from imutui.logbook.reading import Reading
from imutui.logbook.results import TIMINGS
from imutui.session import observe
from imutui.session.engine import Engine
from imutui.session.plan import Plan
from reliability.setting import PERIOD_S


@dataclass(frozen=True)
class ClockSet:
    """What a log shows of clock steps."""

    told_s: list[float]  # steps that its events tell, s
    worst_step_ms: float  # largest departure of a step between stamps from the unit's period
    backwards: int  # messages whose log time is before that of the one before them


def clock_set(folder: Path, steps_s: tuple[float, ...]) -> ClockSet:
    """Set the clock by these steps, one after the other, while an acquisition in this process records."""
    offset = [0]
    clock = SimpleNamespace(monotonic_ns=time.monotonic_ns, time_ns=lambda: time.time_ns() + offset[0])
    with patch.object(log_time, "time", clock), served(VirtualUnit(Still())) as path, Port(path, POWER_UP_BAUD) as port:
        plan = Plan(path, logs=str(folder / "logs"), record=True, filter="none")
        host = Imu400cd(port)
        engine = Engine(plan, host, host.open(plan.baud))
        engine.start()
        for count, step in enumerate(steps_s, 1):
            offset[0] += round(step * 1e9)
            wait_until(lambda count=count: len(_told(engine)) == count)  # type: ignore[misc]
        engine.request_stop()
        assert engine.lifecycle.ended.wait(30.0)
        assert engine.result is not None
    log = Path(engine.result["log"])
    with log.open("rb") as stream:
        messages = [(c.topic, m) for _, c, m in make_reader(stream).iter_messages(log_time_order=False)]
    stamps = np.array([message.publish_time for topic, message in messages if topic == schemas.RAW])
    worst = float(np.max(np.abs(np.diff(stamps) / 1e6 - PERIOD_S * 1e3)))
    told = [float(text.split("by ")[1].split(" s")[0]) for text in _steps(e.text for e in reader.read(log).events)]
    return ClockSet(told, worst, int(np.sum(np.diff([message.log_time for _, message in messages]) < 0)))


def _told(engine: Engine) -> list[str]:
    state = engine.call(lambda acquisition: observe.snapshot(acquisition, 2**62))
    return _steps(event["text"] for event in state["events"])


def _steps(texts: Iterable[str]) -> list[str]:
    return [text for text in texts if "system clock stepped by" in text]


def replays_that_differ(log: Path, speeds: tuple[float | None, ...]) -> int:
    """Replay a log at these speeds; returns how many results differ from the first in any field but the timings."""
    documents = [replay(log, Reading(), speed=speed) for speed in speeds]
    first, *others = [{k: v for k, v in document.items() if k not in TIMINGS} for document in documents]
    return sum(other != first for other in others)
