"""Acquisitions that run in the test's own process, on a unit that it serves, and small disks for them."""

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from helpers.paths import ROOT
from helpers.processes import LIMIT_S, wait_until
from helpers.units import Still, served
from imutui.instrument.imu400 import handshake
from imutui.instrument.imu400.crossbow import POWER_UP_BAUD
from imutui.instrument.imu400.host import Imu400Host
from imutui.instrument.imu400.unit import UnitOptions, VirtualUnit
from imutui.instrument.port import Port
from imutui.session import exit_codes, observe
from imutui.session.engine import Engine
from imutui.session.live_stream import LiveStream
from imutui.session.plan import Plan

_AS_ROOT = ("unshare", "--user", "--map-root-user", "--mount")


class Running:
    """An acquisition that records to logs/a.mcap."""

    def __init__(self, engine: Engine, logs: Path) -> None:
        self.engine = engine
        self.first = logs / "a.mcap"
        self.second = logs / "a_p2.mcap"

    def seen(self) -> Any:
        return self.engine.call(lambda acquisition: observe.snapshot(acquisition, 2**62), late=True)

    def record(self, packets: int = 20) -> None:
        """Have some packets more in the present file, and onto the disk."""
        wanted = self.seen()["packets"] + packets
        wait_until(lambda: self.seen()["packets"] >= wanted)
        self.a_second_passes()

    def a_second_passes(self) -> None:
        self.engine.call(lambda acquisition: acquisition.every_second())

    def end(self) -> Any:
        self.engine.request_stop()
        assert self.engine.lifecycle.ended.wait(60.0)
        return self.engine.result

    def findings(self) -> list[str]:
        assert {finding["exit_code"] for finding in self.engine.lifecycle.findings} <= {exit_codes.DISK}
        return [finding["text"] for finding in self.engine.lifecycle.findings]


@contextmanager
def acquiring(home: Path, stream: LiveStream | None = None, **fields: Any) -> Iterator[Running]:
    """An acquisition in this process, some packets of which are on the disk."""
    logs = home / "logs"
    asked = {"logs": str(logs), "output": str(logs / "a.mcap"), "record": True, "filter": "none"}
    with served(VirtualUnit(Still(), UnitOptions())) as path, Port(path, POWER_UP_BAUD) as port:
        plan = Plan(path, **(asked | fields))
        engine = Engine(plan, Imu400Host(port), handshake.open_dialogue(port, plan.baud), stream)
        running = Running(engine, logs)
        try:
            engine.start()
            running.record()
            yield running
        finally:
            running.end()


def mounts(test: Callable[..., None]) -> Callable[..., None]:
    """A test that mounts disks. Who is not root runs it in a process where he is, in a user namespace of its own."""
    if os.getuid() == 0:
        return test

    def in_a_namespace() -> None:
        this = os.environ["PYTEST_CURRENT_TEST"].rpartition(" ")[0]
        line = [*_AS_ROOT, sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-n0", this]
        own = {name: value for name, value in os.environ.items() if name != "PYTEST_XDIST_WORKER"}
        done = subprocess.run(line, cwd=ROOT, env=own, capture_output=True, text=True, timeout=LIMIT_S, check=False)
        if "unshare" in done.stderr:
            pytest.skip(f"neither root nor a user namespace: {done.stderr}")
        assert done.returncode == 0, done.stdout + done.stderr

    in_a_namespace.__name__, in_a_namespace.__doc__ = test.__name__, test.__doc__
    return in_a_namespace


@contextmanager
def mounted(folder: Path, size: str) -> Iterator[Path]:
    """A disk of that size, mounted on a new folder; skips the test where none can be mounted."""
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(folder)]
    done = subprocess.run(mount, capture_output=True, text=True, timeout=LIMIT_S, check=False)
    if done.returncode != 0:
        pytest.skip(f"no disk can be mounted: {done.stderr}")
    try:
        yield folder
    finally:
        subprocess.run(["umount", "--lazy", str(folder)], capture_output=True, timeout=LIMIT_S, check=False)
