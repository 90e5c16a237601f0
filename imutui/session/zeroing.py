"""What to say of zeroing the unit's rate sensors."""

import numpy as np


def in_words(argument: int, seconds: float, before_dps: np.ndarray | None) -> str:
    """What came of it.

    `argument`: as it was sent.
    `seconds`: until the unit said that it is done.
    `before_dps`: what the rate sensors read before, deg/s, shape (3,).
    """
    done = "erased its stored zero" if argument == 0 else "zeroed its rate sensors"
    read = ""
    if before_dps is not None:
        x, y, z = before_dps
        read = f"; before, they read x {x:+.4f}, y {y:+.4f}, z {z:+.4f} deg/s"
    return f"the unit says that it has {done} ({seconds:.1f} s){read}. The filter begins anew."


def unanswered(argument: int, patience_s: float) -> str:
    """What to say when it did not answer in time."""
    return (
        f"the unit did not say within {patience_s:.0f} s that its rate sensors are zeroed (argument"
        f" {argument}). Whether they are is not known: look at the rates when packets come again. If none come, power"
        " it off and on, then connect again."
    )
