"""Acquisitions that run in the test's own process, on a unit that it serves, and small disks for them."""

import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest

from helpers.commands import imutui_json
from helpers.paths import ROOT
from helpers.processes import LIMIT_S, wait_until
from helpers.units import Still, served
from imutui.instrument.imu400.unit import UnitOptions, VirtualUnit
from imutui.instrument.port import Port
from imutui.instrument.registry import INSTRUMENTS
from imutui.logbook import reader
from imutui.logbook.reader import Log
from imutui.logbook.results import TIMINGS
from imutui.logbook.session_info import SessionInfo
from imutui.session import lifecycle, observe
from imutui.session.acquisition import Acquisition
from imutui.session.engine import Engine
from imutui.session.lifecycle import Lifecycle
from imutui.session.plan import Plan
from imutui.session.snapshot import NO_SERIES

_AS_ROOT = ("unshare", "--user", "--map-root-user", "--mount")


def untimed(document: Mapping[str, Any]) -> dict[str, Any]:
    """A result but for its timings and for what the others of a recording's files are."""
    return {key: value for key, value in document.items() if key not in (*TIMINGS, "parts")}


def replayed(log: str | Path, code: int | None = 0) -> dict[str, Any]:
    """What the command `replay` makes of a log, without timings."""
    return untimed(imutui_json("replay", log, check=code))


class Running:
    """An acquisition in this process, over a line that is open."""

    def __init__(self, engine: Engine, line: Port, logs: Path) -> None:
        self.engine, self.line = engine, line
        self.first, self.second = logs / "a.mcap", logs / "a_p2.mcap"

    def seen(self, since: int = NO_SERIES) -> Any:
        return self.engine.call(lambda it: observe.snapshot(it, since), timeout=LIMIT_S, late=True)

    def more_packets(self, count: int = 20) -> None:
        wanted = self.seen()["packets"] + count
        wait_until(lambda: self.seen()["packets"] >= wanted)

    def record(self, packets: int = 20) -> None:
        """Have some packets more in the present file, and onto the disk."""
        self.more_packets(packets)
        self.a_second_passes()

    def a_second_passes(self) -> None:
        self.engine.call(lambda acquisition: acquisition.every_second())

    def wait_until_lost(self) -> None:
        wait_until(lambda: self.seen()["reconnecting"] is not None)

    def wait_until_ended(self) -> Any:
        assert self.engine.lifecycle.ended.wait(LIMIT_S)
        return self.engine.result

    def end(self) -> Any:
        """Result of its last recording, once it was stopped."""
        self.engine.request_stop()
        return self.wait_until_ended()

    def content(self) -> tuple[list[str], Log]:
        """Stop it, which goes well; returns the events of its last file, and all that is in it."""
        result = self.end()
        assert self.engine.lifecycle.error is None
        log = reader.read(Path(result["log"]), raw=True)
        assert log.finished
        assert not log.damage
        return [event.text for event in log.events], log

    def findings(self) -> list[str]:
        assert {finding["exit_code"] for finding in self.engine.lifecycle.findings} <= {lifecycle.DISK}
        return [finding["text"] for finding in self.engine.lifecycle.findings]


class _NoReader:
    """Stands where an acquisition has its reader, and reads nothing."""

    last_packet_ns = 0

    def ask_again(self) -> None:
        """Nothing is asked."""


def unread(plan: Plan, info: SessionInfo) -> Acquisition:
    """An acquisition without threads, to which a test hands what it takes."""
    return Acquisition(plan, info, _NoReader(), Lifecycle())  # type: ignore[arg-type]


@contextmanager
def acquiring(home: Path, at: str | None = None, packets: int = 20, **fields: Any) -> Iterator[Running]:
    """An acquisition that records to logs/a.mcap, of a unit at a port or a still IMU400CD, after its first packets."""
    logs = home / "logs"
    asked = {"logs": str(logs), "output": str(logs / "a.mcap"), "record": True, "filter": "none"} | fields
    with ExitStack() as stack:
        plan = Plan(at or stack.enter_context(served(VirtualUnit(Still(), UnitOptions()))), **asked)
        instrument = INSTRUMENTS[plan.instrument]
        line = stack.enter_context(Port(plan.port, instrument.power_up_bauds[0]))
        host = instrument(line, plan.rate_hz if plan.sampling == "stream" else None)
        running = Running(Engine(plan, host, host.open(plan.baud)), line, logs)
        try:
            running.engine.start()
            if packets:
                running.record(packets)
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
