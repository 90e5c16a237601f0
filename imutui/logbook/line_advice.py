"""Where to look when packets are lost or damaged, or none come: it depends on what lies between unit and computer."""

import math
import os

HELD_UP_S = 0.25  # what was read later than this after it was sampled shows that the reading was held up
NEAR_S = 0.5  # what is lost so soon after something was read late, by when it was read, is lost because of it

_REST = "replay and trace take what is there."


class LossAdvice:
    """What to look at, briefly, of an acquisition that loses packets.

    `port`, `firmware`: see `imutui.logbook.session_info.SessionInfo`.
    """

    def __init__(self, port: str, firmware: str) -> None:
        self._line = kind(port, firmware)
        self._lost = 0
        self._lost_held_up = 0
        self._late_read_s = -math.inf

    def packet(self, lost_before: int, read_s: float, late_s: float) -> None:
        """Take note of a packet: so many were lost before it; when it was read, and how long after it was sampled."""
        if late_s > HELD_UP_S:
            self._late_read_s = read_s
        # what waited before an overrun was read late, and at once; behind it all may be fresh
        if read_s - self._late_read_s < NEAR_S:
            self._lost_held_up += lost_before
        self._lost += lost_before

    @property
    def held_up(self) -> bool:
        """Whether most packets were lost while the reading was held up."""
        return 2 * self._lost_held_up > self._lost

    @property
    def brief(self) -> str:
        """Where to look, in a few words."""
        return _BRIEF_HELD_UP if self.held_up and self._line != "network" else _BRIEF[self._line]


def kind(port: str, firmware: str) -> str:
    """What the line is: "cable", "network" or "pseudo-terminal"."""
    if "://" in port:
        return "network"
    if "VIRTUAL" in firmware.upper() or os.path.realpath(port).startswith("/dev/pts/"):
        return "pseudo-terminal"
    return "cable"


def of_losses(port: str, firmware: str, *, held_up: bool) -> str:
    """Where to look when packets were lost or damaged, and that the rest can be used: sentences.

    `port`, `firmware`: see `imutui.logbook.session_info.SessionInfo`.
    `held_up`: whether they were lost while the reading was held up.
    """
    line = kind(port, firmware)
    # a network waits for whoever reads late
    return f"{_HELD_UP if held_up and line != 'network' else _LONG[line]}; {_REST}"


def of_silence(port: str, firmware: str) -> str:
    """Where to look when nothing comes, in a few words."""
    return _SILENCE[kind(port, firmware)]


_HELD_UP = (
    "The computer was too busy to read in time, and what came meanwhile overran: leave it less to do while it records"
)
_BRIEF_HELD_UP = "this computer was too busy to read in time"
_LONG = {
    "cable": "Check the cable, the ground and the line speed",
    "network": "Check the network and the terminal server, then the cable behind it",
    "pseudo-terminal": "The port is a pseudo-terminal, so it is no cable: look at the faults of the virtual unit, and"
    " at what else the computer had to do",
}
_BRIEF = {
    "cable": "check the cable",
    "network": "check the network",
    "pseudo-terminal": "no cable, a pseudo-terminal",
}
_SILENCE = {
    "cable": "check power and cable",
    "network": "check power and network",
    "pseudo-terminal": "does the virtual unit run?",
}
