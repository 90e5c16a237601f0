"""Acquisitions that are forked from a process which has loaded what they need."""

import os
import signal
import subprocess
from pathlib import Path

import pytest
from helpers.places import own_places
from helpers.processes import end_owner, has_ended, wait_until
from helpers.units import virtual

from imutui.logbook import reader
from imutui.session import client
from imutui.session.client import SessionError
from imutui.session.plan import Plan
from imutui.session.processes import Parent, Process


def test_what_is_forked_outlives_its_parent_and_the_death_of_another(tmp_path: Path) -> None:
    with pytest.MonkeyPatch.context() as patch, virtual() as first, virtual() as second:
        runtime = own_places(patch, tmp_path)
        plans = [Plan(port, name=name, record=True, logs=str(tmp_path)) for name, port in (("a", first), ("b", second))]
        with Parent() as parent:
            a, b = (client.start(plan, parent=parent) for plan in plans)
            assert os.getsid(a.pid) == a.pid != os.getsid(b.pid) == b.pid
            with pytest.raises(SessionError, match="is in use by"):
                client.start(Plan(first, name="c", filter="none"), parent=parent)
        lost = Path(str(a.snapshot()["recording"]["path"]))  # type: ignore[index]
        wait_until(lambda: (b.snapshot()["filter"] or {}).get("samples"))  # type: ignore[return-value]
        os.kill(a.pid, signal.SIGKILL)
        wait_until(lambda: has_ended(a.pid))
        before = b.snapshot()["packets"]
        wait_until(lambda: b.snapshot()["packets"] > before + 20)
        result = b.stop()["result"]
        wait_until(lambda: has_ended(b.pid))
        for lock in (runtime / "imutui").glob("*.lock"):
            end_owner(lock)
    assert result is not None
    assert result["finished"]
    assert result["lost_packets"] == 0
    assert not reader.read(lost).finished


def test_a_child_that_has_ended_by_then_is_one_that_has_ended() -> None:
    """It may fail before its number has come over: the other units of a batch are not given up for it."""
    with subprocess.Popen(["true"]) as process:
        process.wait()
    forked = Process(process.pid)
    forked.send(signal.SIGKILL)
    assert forked.has_ended()
