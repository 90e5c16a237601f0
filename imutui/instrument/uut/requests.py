"""Asking a 440, 380 or 381 for something and waiting for its answer, while packets of a stream may come in between.

Replies are told apart by their type, so that nothing has to be quiet for it.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeVar

from imutui.instrument.discarded import Discarded
from imutui.instrument.host import PATIENCE_S
from imutui.instrument.port import Port
from imutui.instrument.uut.decoder import Decoder
from imutui.instrument.uut.messages import (
    Event,
    Fields,
    FieldsSet,
    GetFields,
    GetPacket,
    Identification,
    Memory,
    Ping,
    Refused,
    Reply,
    Request,
    Reset,
    SetFields,
    Version,
)
from imutui.instrument.uut.payloads import IDENTIFICATION, VERSION, encode, frame_of

_TRIES = 2
_USUAL_S = 0.4

ReplyT = TypeVar("ReplyT", bound=Reply)


@dataclass(slots=True)
class Requests:
    """Asks one thing after the other."""

    port: Port  # at the unit's speed
    patience_s: float = PATIENCE_S  # how long to wait for a reply
    slowest_s: float = field(default=0.0)  # how long the slowest reply so far took

    def ping(self, patience_s: float) -> bool:
        """Whether the unit answers a ping."""
        return self._ask(Ping(), Ping, lambda reply: True, patience_s, 1) is not None

    def hear_frame(self, patience_s: float) -> bool:
        """Whether a whole frame comes: of a stream, or the answer to a ping that was sent already."""
        decoder, began = Decoder(), time.monotonic()
        while time.monotonic() - began < patience_s:
            data = self.port.read(decoder.missing)
            if any(not isinstance(event, Discarded) for event in (decoder.feed(data) if data else decoder.pause())):
                return True
        return False

    def identification(self) -> Identification | None:
        """Serial number and text."""
        return self.ask(GetPacket(IDENTIFICATION), Identification)

    def version(self) -> Version | None:
        """Version of the firmware."""
        return self.ask(GetPacket(VERSION), Version)

    def fields(self, ids: tuple[int, ...], memory: Memory = Memory.RAM) -> dict[int, int]:
        """Fields in force, or those of the next power-up, as far as there are such."""
        reply = self.ask(
            GetFields(memory, ids),
            Fields,
            lambda reply: reply.memory is memory and dict(reply.values).keys() <= set(ids),
        )
        return {} if reply is None else dict(reply.values)

    def put(self, values: dict[int, int]) -> bool:
        """Put fields in force, until the next power-up; whether the unit has taken all of them."""
        # the reply of a slow unit may be that to an earlier request, of other fields
        reply = self.ask(
            SetFields(Memory.RAM, tuple(values.items())),
            FieldsSet,
            lambda reply: reply.memory is Memory.RAM and set(reply.ids) <= values.keys(),
        )
        return reply is not None and set(values) <= set(reply.ids)

    def reset(self) -> bool:
        """Have the unit restart as after power-up; whether it says that it does."""
        return self._ask(Reset(), Reset, lambda reply: True, self.patience_s, 1) is not None

    def ask(
        self, request: Request, kind: type[ReplyT], fits: Callable[[ReplyT], bool] = lambda reply: True
    ) -> ReplyT | None:
        """Send a request and wait for its reply; None if it does not come, or the unit refuses."""
        return self._ask(request, kind, fits, self.patience_s, _TRIES)

    def _ask(
        self, request: Request, kind: type[ReplyT], fits: Callable[[ReplyT], bool], patience_s: float, tries: int
    ) -> ReplyT | None:
        asked = frame_of(request).type
        for _ in range(tries):
            decoder, began = Decoder(), time.monotonic()
            self.port.write(encode(request))
            while time.monotonic() - began < patience_s:
                data = self.port.read(decoder.missing)
                for event in decoder.feed(data) if data else decoder.pause():
                    if isinstance(event, kind) and fits(event):
                        self.slowest_s = max(self.slowest_s, time.monotonic() - began)
                        return event
                    if _refuses(event, asked):
                        return None
        return None


def _refuses(event: Event, asked: bytes) -> bool:
    return isinstance(event, Refused) and event.type == asked
