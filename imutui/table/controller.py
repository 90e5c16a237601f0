"""What a controller of a turn table is: degrees and seconds, axes by the names of `filters.motion.segments.AXES`."""

from collections.abc import Callable
from typing import Protocol

from imutui.table.motion import Limits, Motion, TableState


class TableError(Exception):
    """The table can't do it, or does not as it should; says what, where, and what next."""


class TableLinkError(TableError):
    """The controller can't be reached, or does not answer; what the table does meanwhile is not known."""


class TableController(Protocol):
    """A controller on the line. Every method returns when it is done.

    Methods raise TableError if the table does not do it, and TableLinkError if the controller cannot be asked. What is
    commanded has been checked (`imutui.table.motion`): a controller knows limits, and checks none.
    """

    axes: tuple[str, ...]  # which of AXES it has, in the order of its numbers
    meanwhile: Callable[[], None]  # called before each command, and while an answer is awaited; it may raise

    def identify(self) -> str:
        """Return the controller's identification."""
        ...

    def limits(self) -> Limits:
        """Return the limits of each axis, as the controller reports them."""
        ...

    def enable(self) -> None:
        """Close the interlock, so that drives are ready, with the mode of all axes off.

        Raises InputError if a mode is on or an axis turns: another host commands the table.
        """
        ...

    def start(self, motion: Motion) -> None:
        """Begin a motion of an axis; the angle of a move is sent as it is.

        Raises InputError if the table has no such axis; nothing is sent then.
        """
        ...

    def read(self) -> TableState:
        """Return the present angles and rates."""
        ...

    def stop(self, brakes_s: float | None = None) -> None:
        """Bring all axes to rest: rate zero and rate mode of every axis, then mode off of every axis, unasked.

        `brakes_s`: time that the axes take to come to rest, at most. Then nothing is asked before the mode is off.
          Without it the controller is asked for rates until all axes rest.
        Raises TableError if the controller does not confirm that all axes rest with their modes off.
        """
        ...

    def disable(self) -> None:
        """Open the interlock, after a stop if a mode is on."""
        ...

    def close(self) -> None:
        """Close the link; the table goes on with what it does."""
        ...
