"""Asking the unit for something it answers with one reply, and waiting for that: a slow unit's too, and no other reply.

The unit answers one thing after the other. So the reply to a later command is the sign that an earlier one's does not
come any more; and a letter counts as a reply only where it stands alone, since late text has letters too.
"""

import time
from dataclasses import dataclass
from typing import TypeVar

from imutui.instrument.discarded import Discarded
from imutui.instrument.host import PATIENCE_S, QUICK_S
from imutui.instrument.imu400.crossbow import Command, Decoder, Version, encode
from imutui.instrument.imu400.messages import REPLY_LETTERS
from imutui.instrument.port import Port

# a reply that came damaged is no reply that is yet to come
_DAMAGED_BYTES, _REST_S = 4, 0.3
# two bytes at the lowest speed: by then what stands behind a letter has begun to come
_BEHIND_S = 0.003

T = TypeVar("T")


@dataclass(slots=True)
class Asker:
    """Asks one thing after the other, on a quiet line."""

    port: Port  # of a unit that is polled, at its own speed
    patience_s: float = PATIENCE_S  # how long to wait for a reply
    tries: int = 2  # how often at most to ask for what comes damaged
    slowest_s: float = 0.0  # how long the slowest reply so far took

    def ask(self, command: Command, kind: type[T], patience_s: float | None = None) -> T | None:
        """Send a command and wait for its reply; None if it does not come, or came damaged each time."""
        for _ in range(self.tries):
            began = time.monotonic()
            reply, noise = _exchange(self.port, command, kind, patience_s or self.patience_s)
            if reply is not None:
                self.slowest_s = max(self.slowest_s, time.monotonic() - began)
                return reply
            if not noise:
                break
        return None

    @property
    def usual_s(self) -> float:
        """How long a reply may take, by those that have come."""
        return max(QUICK_S, 3.0 * self.slowest_s)


def _exchange(port: Port, command: Command, kind: type[T], patience_s: float) -> tuple[T | None, int]:
    """The reply to a command, if it comes, and how many bytes came that were no part of it."""
    decoder = Decoder()
    decoder.expect_reply(command)
    port.write(encode(command))
    began = last = time.monotonic()
    noise, since_quiet = 0, 0
    while True:
        data = port.read(decoder.missing)
        events = decoder.feed(data) if data else decoder.quiet()
        since_quiet = since_quiet + len(data) if data else 0
        reply = next((event for event in events if isinstance(event, kind)), None)
        if reply is not None and _stands_alone(port, reply, since_quiet, quiet=not data):
            return reply, noise
        noise += sum(len(event.data) for event in events if isinstance(event, Discarded)) + (reply is not None)
        if reply is not None:  # a letter of something else: the reply itself is still awaited
            decoder.expect_reply(command)
        now = time.monotonic()
        last = now if data else last
        if not data and (now - began > patience_s or (noise >= _DAMAGED_BYTES and now - last > _REST_S)):
            return None, noise


def _stands_alone(port: Port, reply: object, since_quiet: int, *, quiet: bool) -> bool:
    """Whether a reply is one, and not a part of something else."""
    if isinstance(reply, Version) and not quiet:
        # the longest text that is a reply has come, and perhaps not all that was said
        while port.read(64):
            pass
    if reply not in REPLY_LETTERS:
        return True
    time.sleep(_BEHIND_S)
    return since_quiet == 1 and not port.waiting()
