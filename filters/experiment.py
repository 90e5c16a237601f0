"""The motion and the temperatures that would separate two rivals."""

from typing import Any

from filters.evidence import Atom, Design
from filters.residual import Run
from filters.types import Array


def separating(design: Design, a: Atom, theta: Array, b: Atom, run: Run) -> dict[str, Any] | None:
    """To be done."""
    return None
