"""Folders of a test's own, so that its acquisitions are found by nobody else, and it finds nobody's."""

from pathlib import Path

import pytest


def variables_of(folder: Path) -> dict[str, str]:
    """Sockets, cache and configuration in this folder."""
    (folder / "run").mkdir(mode=0o700, exist_ok=True)
    places = {"XDG_RUNTIME_DIR": "run", "XDG_CACHE_HOME": "cache", "XDG_CONFIG_HOME": "config"}
    return {name: str(folder / place) for name, place in places.items()}


def own_places(patch: pytest.MonkeyPatch, folder: Path) -> Path:
    """Have sockets, cache and configuration here; returns the folder of sockets."""
    for name, value in variables_of(folder).items():
        patch.setenv(name, value)
    return folder / "run"
