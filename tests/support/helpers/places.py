"""Folders of a test's own, so that its acquisitions are found by nobody else, and it finds nobody's."""

import os
from pathlib import Path

import pytest


def own_places(patch: pytest.MonkeyPatch, folder: Path) -> Path:
    """Have sockets, cache and configuration here, and no setting from outside; returns the folder of sockets."""
    runtime = folder / "run"
    runtime.mkdir(mode=0o700, exist_ok=True)
    for name in ("cache", "config"):
        patch.setenv(f"XDG_{name.upper()}_HOME", str(folder / name))
    patch.setenv("XDG_RUNTIME_DIR", str(runtime))
    for name in [name for name in os.environ if name.startswith("IMUTUI_")]:
        patch.delenv(name)
    return runtime
