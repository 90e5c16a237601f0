"""A websocket that serves what a log holds, or what is written into it, to Foxglove.

The only user of foxglove-sdk; viewers come through `origin_gate`. Channels are those of the file: names, types,
encoding, metadata. A log that grows is read as a file, so the process that writes it does not know of this one.
"""

import contextlib
import itertools
import logging
import queue
import sys
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, cast

from imutui.logbook import file_lock, reader, schemas, walk
from imutui.logbook.mcap_format import MAGIC
from imutui.logbook.mcap_stream import Messages
from imutui.logbook.walk import Damage, End, Item
from imutui.origin_gate import AddressError, OriginGate, listen, loopback_address
from imutui.plain_text import visible

if TYPE_CHECKING:
    import foxglove
    from foxglove.websocket import ChannelView, Client, ServerListener

LOOK_S = 0.1
"""Seconds between two looks whether a log has grown."""
_LAST_MESSAGES_S = 0.3
# messages that wait for a slow viewer, ten seconds at the full rate; the library then drops its oldest
_BACKLOG = 4096


class _Subscriptions:
    """Subscriptions of viewers. The library calls the methods in threads of its own.

    `new`: topics with a new subscription, until they are taken from it.
    """

    def __init__(self) -> None:
        self.new: queue.SimpleQueue[str] = queue.SimpleQueue()

    def on_subscribe(self, client: "Client", channel: "ChannelView") -> None:
        del client
        self.new.put(channel.topic)

    def on_unsubscribe(self, client: "Client", channel: "ChannelView") -> None:
        pass


class _LibraryMessages(logging.Handler):
    """Print the library's warnings on stderr, and that a viewer is too slow, which the library repeats now and then."""

    def emit(self, record: logging.LogRecord) -> None:
        text = record.getMessage()
        if record.levelno >= logging.WARNING or "outbox" in text:
            print(visible(f"stream for Foxglove: {text}"), file=sys.stderr)


class _Clock:
    """The time of a log that is played, from the next subscription on, until `stop` is set."""

    def __init__(self, subscriptions: _Subscriptions, stop: threading.Event) -> None:
        self._subscriptions, self._stop = subscriptions, stop
        self._offset_s: float | None = None  # monotonic time less log time

    def reaches(self, log_ns: int) -> bool:
        """Wait until it is this log time (UTC, ns); return whether it is, and nothing has ended it before."""
        if self._offset_s is None:
            while self._subscriptions.new.empty() and not self._stop.wait(LOOK_S):
                pass
            self._stop.wait(LOOK_S)  # for the other subscriptions of this viewer
            self._offset_s = time.monotonic() - log_ns / 1e9
        return not self._stop.wait(max(0.0, log_ns / 1e9 + self._offset_s - time.monotonic()))


def _up_to_end(items: Iterator[Item]) -> Iterator[Item]:
    """Yield the items before the next `End`."""
    return itertools.takewhile(lambda item: not isinstance(item, End), items)


class FoxgloveServer:
    """The websocket, with the channels of all logs that were served so far.

    `host`, `port`: where viewers find it.
    `name`: shown by viewers.
    `origins`: further origins of pages that may read the stream, see `origin_gate`.
    `stop`: ends `serve` once it is set.
    Raises AddressError if it cannot listen there.
    """

    def __init__(self, host: str, port: int, name: str, origins: frozenset[str], stop: threading.Event) -> None:
        import foxglove

        self._stop, self._subscriptions = stop, _Subscriptions()
        logger = logging.getLogger("foxglove")
        logger.addHandler(_LibraryMessages(logging.INFO))
        logger.setLevel(logging.INFO)
        logger.propagate = False
        foxglove.set_log_level("INFO")
        listener = cast("ServerListener", self._subscriptions)  # clients only watch: nothing else is called
        self._listener, behind = listen(host, port), loopback_address()
        try:
            self._server = foxglove.start_server(
                name=name, host=behind, port=0, server_listener=listener, message_backlog_size=_BACKLOG
            )
        except (RuntimeError, OSError) as error:
            raise AddressError(f"foxglove-sdk cannot listen at {behind}: {error}") from error
        self._behind, self._origins = (behind, self._server.port), origins
        self._gate: OriginGate | None = None
        self._channels: dict[tuple[object, ...], foxglove.Channel] = {}
        self._transforms: Callable[[], None] | None = None  # sends the last message of `/tf_static`

    def serve(self, path: Path, *, from_now: bool = True) -> Damage | None:
        """Serve a log up to its end; return the damage at which it ends, if any.

        A log that a process writes is sent as it grows, any other in its own time from the first subscription on.

        `from_now`: whether messages that a growing log holds already are left out.
        Raises UnreadableLogError if the file is no log.
        """
        with contextlib.closing(reader.opened(path)) as stream:
            if not MAGIC.startswith(stream.read(len(MAGIC))):
                raise reader.UnreadableLogError(reader.foreign(path))
            growing = file_lock.is_held(stream)
            clock = None if growing else _Clock(self._subscriptions, self._stop)
            content, items = Messages(), walk.follow(stream)
            # viewers know all channels before the first message, and the transforms, wherever in the file they are
            for item in _up_to_end(items):
                for message in content.of(item, schemas.TRANSFORMS):
                    channel = self._channel(content, message.channel_id)
                    self._transforms = partial(channel.log, message.data, log_time=message.log_time)
            for number in content.channels:
                self._channel(content, number)
            # not before: the library drops a subscription that comes just when its channel is made
            self._gate = self._gate or OriginGate(self._listener, self._behind, self._origins)
            if not (growing and from_now):
                items = walk.follow(stream)
            while True:
                damage = None
                for item in _up_to_end(items):
                    for message in content.of(item):
                        if clock is not None and not clock.reaches(message.log_time):
                            return None
                        self._latch()
                        channel = self._channel(content, message.channel_id)
                        channel.log(message.data, log_time=message.log_time)
                        if channel.topic() == schemas.TRANSFORMS:
                            self._transforms = partial(channel.log, message.data, log_time=message.log_time)
                    damage = item if isinstance(item, Damage) else None
                self._latch()
                if not growing:
                    return damage
                growing = file_lock.is_held(stream) and not self._stop.wait(LOOK_S)

    def _channel(self, content: Messages, number: int) -> "foxglove.Channel":
        import foxglove

        channel, schema = content.channels[number]
        key = channel.topic, channel.message_encoding, schema.name, schema.encoding, schema.data
        if key not in self._channels:
            self._channels[key] = foxglove.Channel(
                channel.topic,
                message_encoding=channel.message_encoding,
                schema=foxglove.Schema(name=schema.name, encoding=schema.encoding, data=schema.data),
                metadata=channel.metadata,
            )
        return self._channels[key]

    def _latch(self) -> None:
        """Send the transforms, which come once in a file, to new subscribers; the others get them again."""
        with contextlib.suppress(queue.Empty):
            while self._transforms is not None:
                if self._subscriptions.new.get_nowait() == schemas.TRANSFORMS:
                    self._transforms()

    def close(self) -> None:
        """Send what waits and end the connections."""
        time.sleep(_LAST_MESSAGES_S)
        self._server.stop()
        if self._gate is not None:
            self._gate.close()
        self._listener.close()
