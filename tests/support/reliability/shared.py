"""What takes seconds to happen and several tests look at: it happens once, and its files stay."""

import pickle
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import pytest
from helpers.places import own_places
from helpers.shared import once

T = TypeVar("T")


def once_measured(factory: pytest.TempPathFactory, name: str, measure: Callable[[Path], T]) -> tuple[T, Path]:
    """What a function measures in a folder of its own, and that folder; by whoever needs it first."""

    def make(folder: Path) -> None:
        with pytest.MonkeyPatch.context() as patch:
            own_places(patch, folder)
            patch.chdir(folder)
            (folder / "measured").write_bytes(pickle.dumps(measure(folder)))

    folder = once(factory, name, make)
    return pickle.loads((folder / "measured").read_bytes()), folder
