"""Where acquisitions are looked for: shells of one user on one machine need not have the same environment."""

import fcntl
import os
import threading
from pathlib import Path

import pytest

from imutui.session import ipc
from imutui.session.ipc import NameTakenError


@pytest.fixture
def other(home: Path) -> Path:
    """A second runtime folder, as another shell may have it."""
    made = home / "other"
    made.mkdir(mode=0o700)
    return made


def runtime(patch: pytest.MonkeyPatch, folder: Path | None) -> None:
    """Be in a shell with this XDG_RUNTIME_DIR, or with none."""
    if folder is None:
        patch.delenv("XDG_RUNTIME_DIR", raising=False)
    else:
        patch.setenv("XDG_RUNTIME_DIR", str(folder))


@pytest.mark.parametrize(("ours", "theirs"), [("run", None), (None, "run"), ("run", "other"), ("other", "run")])
def test_a_name_taken_in_one_environment_is_seen_in_every_other(
    home: Path, other: Path, monkeypatch: pytest.MonkeyPatch, ours: str | None, theirs: str | None
) -> None:
    runtime(monkeypatch, home / ours if ours else None)
    descriptor = ipc.lock("table")
    here = ipc.socket_path("table")
    try:
        runtime(monkeypatch, home / theirs if theirs else None)
        assert ipc.names() == ["table"]
        assert ipc.socket_path("table") == here
        assert here.parent != ipc.folder()
        with pytest.raises(NameTakenError):
            ipc.lock("table")
    finally:
        os.close(descriptor)
    assert ipc.names() == []
    assert ipc.socket_path("table").parent == ipc.folder()


def test_links_to_folders_that_went_away_are_cleared(home: Path, other: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A runtime folder ends with the log-in; its link goes when the next name is taken."""
    runtime(monkeypatch, other)
    os.close(ipc.lock("first"))
    for left in (other / "imutui").iterdir():
        left.unlink()
    (other / "imutui").rmdir()
    runtime(monkeypatch, home / "run")
    os.close(ipc.lock("second"))
    assert ipc.folders() == [home / "run" / "imutui", home / "cache" / "imutui" / "run"]
    assert [link.resolve() for link in (home / "cache" / "imutui" / "run").iterdir()] == [home / "run" / "imutui"]


def test_a_cache_that_cannot_be_written_costs_only_the_link(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (home / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(home / "file"))
    descriptor = ipc.lock("alone")
    assert ipc.names() == ["alone"]
    os.close(descriptor)


def test_who_only_looks_whether_a_name_is_taken_keeps_nobody_from_taking_it(home: Path) -> None:
    """`status` may look at the very moment at which an acquisition begins, and another `status` at the same time."""
    del home
    os.close(ipc.lock("table"))
    path = ipc.folder() / "table.lock"
    with path.open("rb") as looker:
        fcntl.flock(looker, fcntl.LOCK_SH)
        assert not ipc.is_locked(path)
        timer = threading.Timer(0.05, fcntl.flock, (looker, fcntl.LOCK_UN))
        timer.start()
        descriptor = ipc.lock("table")
        timer.join()
    assert ipc.is_locked(path)
    os.close(descriptor)
