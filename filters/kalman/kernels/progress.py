"""How far compiling the step has come, in sentences for whoever waits for it."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from numba.core import event

from filters.kalman.kernels import extra_states
from filters.kalman.kernels.arithmetic import PARTS


class _Listener(event.Listener):
    """Counts the parts of the step as numba finishes them."""

    def __init__(self, say: Callable[[str], None], parts: list[Any]) -> None:
        self._say = say
        self._missing = {id(part) for part in parts if not part.signatures}
        self._count = len(parts)

    def on_start(self, event: event.Event) -> None:
        """Nothing: a part is told when it is finished."""

    def on_end(self, event: event.Event) -> None:
        """Tell how many of the parts there are."""
        part = id(event.data["dispatcher"])
        if part in self._missing:
            self._missing.remove(part)
            done = self._count - len(self._missing)
            self._say(f"compiling the filter, once on this machine: {done} of {self._count} parts")


@contextmanager
def told(say: Callable[[str], None], *, effects: bool) -> Iterator[None]:
    """Tell how far compiling has come; nothing is said where the step comes from the disk.

    `say`: takes a sentence, after each part.
    `effects`: whether what effects need is compiled as well.
    """
    own = [part for part in PARTS if effects or part.py_func.__module__ != extra_states.__name__]
    with event.install_listener("numba:compile", _Listener(say, own)):
        yield
