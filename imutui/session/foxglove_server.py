"""The process that serves a live stream to Foxglove.

`python -m imutui.session.foxglove_server HOST PORT NAME ORIGINS SOCKET`, started by `live_stream`, which says why it is
a process. The only user of foxglove-sdk; viewers come through `origin_gate`. Channels are those of the file: names,
types, encoding, metadata. It ends when the acquisition closes the socket, or dies, and ignores signals that ask the
acquisition to end: that one finishes its file first.
"""

import contextlib
import errno
import json
import logging
import os
import queue
import signal
import socket
import sys
import time
from typing import TYPE_CHECKING, cast

from imutui.logbook import schemas
from imutui.plain_text import visible
from imutui.session import origin_gate
from imutui.session.live_stream import MESSAGE, MESSAGE_LIMIT, TOPICS
from imutui.session.origin_gate import OriginGate

if TYPE_CHECKING:
    from foxglove import Channel
    from foxglove.websocket import ChannelView, Client, ServerListener

_REPORT_S = 0.5
_NICENESS = 5
_LAST_MESSAGES_S = 0.3
# messages that wait for a viewer that is slow, ten seconds at the full rate; then its oldest are left out
_BACKLOG = 4096
_TRANSFORMS = TOPICS.index(schemas.TRANSFORMS)
_RAW = TOPICS.index(schemas.RAW)


class Subscriptions:
    """Who watches what. The library calls the methods in threads of its own.

    `new`: topics that somebody has subscribed to, until they are taken from it.
    """

    def __init__(self) -> None:
        self.new: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._channels: dict[int, set[int]] = {}

    @property
    def viewers(self) -> int:
        """Clients with a subscription."""
        return sum(bool(channels) for channels in list(self._channels.values()))

    def on_subscribe(self, client: "Client", channel: "ChannelView") -> None:
        """Take note of a subscription."""
        self._channels.setdefault(client.id, set()).add(channel.id)
        self.new.put(channel.topic)

    def on_unsubscribe(self, client: "Client", channel: "ChannelView") -> None:
        """Take note that one has ended, also because its client has gone."""
        self._channels.get(client.id, set()).discard(channel.id)


class LibraryMessages(logging.Handler):
    """What the library says: of viewers that do not keep up it is counted, warnings go to stderr.

    `slow`: how often a viewer's backlog was said to be full; the library says it again after a while only.
    """

    def __init__(self) -> None:
        super().__init__(logging.INFO)
        self.slow = 0

    def emit(self, record: logging.LogRecord) -> None:
        """Take one."""
        text = record.getMessage()
        self.slow += "outbox" in text
        if record.levelno >= logging.WARNING:
            print(visible(f"stream for Foxglove: {text}"), file=sys.stderr)


def main() -> int:
    """Serve until the socket's other end is closed."""
    host, port, name, origins, descriptor = sys.argv[1:]
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    os.nice(_NICENESS)  # the acquisition comes first
    feed = socket.socket(fileno=int(descriptor))
    try:
        server = _Server(host, int(port), name, frozenset(origins.lower().split()))
    except _RefusedError as error:
        _tell(feed, {"error": str(error)})
        return 1
    _tell(feed, {})
    server.serve(feed)
    return 0


class _RefusedError(Exception):
    """The server cannot begin; the message is for the user."""


class _Server:
    def __init__(self, host: str, port: int, name: str, origins: frozenset[str]) -> None:
        try:
            import foxglove
        except ImportError as error:
            raise _RefusedError(
                "a stream for Foxglove needs foxglove-sdk, which is not installed: it is the extra `live` of imutui"
                " (pip install 'imutui[live]')."
            ) from error
        self._subscriptions, self._messages = Subscriptions(), LibraryMessages()
        logger = logging.getLogger("foxglove")
        logger.addHandler(self._messages)
        logger.setLevel(logging.INFO)
        logger.propagate = False
        foxglove.set_log_level("INFO")
        listener = cast("ServerListener", self._subscriptions)  # clients only watch: nothing else is called
        behind = origin_gate.loopback_address()
        try:
            self._server = foxglove.start_server(
                name=name, host=behind, port=0, server_listener=listener, message_backlog_size=_BACKLOG
            )
        except (RuntimeError, OSError, ValueError, OverflowError) as error:
            raise _RefusedError(_refusal(host, port, error)) from error
        try:
            self._gate = OriginGate(host, port, (behind, self._server.port), origins)
        except OSError as error:
            raise _RefusedError(_refusal(host, port, error)) from error
        self._channels = [_channel(topic, schemas.TYPES[topic]) for topic in TOPICS]
        self._has_details = False
        self._transform: tuple[bytes, int] | None = None

    def serve(self, feed: socket.socket) -> None:
        """Hand on what comes, and report, until there is no more."""
        feed.settimeout(_REPORT_S)
        told, report_at = "", 0.0
        while True:
            with contextlib.suppress(TimeoutError):
                message = _received(feed)
                if not message:
                    break
                self._log(message)
            self._latched()
            if time.monotonic() >= report_at:
                report_at = time.monotonic() + _REPORT_S
                told = self._report(feed, told)
        if self._subscriptions.viewers:
            time.sleep(_LAST_MESSAGES_S)
        self._server.stop()
        self._gate.close()

    def _log(self, message: bytes) -> None:
        number, log_ns = MESSAGE.unpack_from(message)
        data = message[MESSAGE.size :]
        if number == _RAW and not self._has_details and len(data) == schemas.RAW_DTYPE.itemsize:
            # which instrument answers was not known when the channels were made
            self._has_details = True
            self._channels[number].close()
            self._channels[number] = _channel(schemas.RAW, schemas.raw_type(details=True))
        self._channels[number].log(data, log_time=log_ns)
        if number == _TRANSFORMS:
            self._transform = data, log_ns

    def _latched(self) -> None:
        """Send the transform, which comes once in a file, to who has come since; the others get it again."""
        with contextlib.suppress(queue.Empty):
            while self._transform is not None:
                if self._subscriptions.new.get_nowait() == schemas.TRANSFORMS:
                    self._channels[_TRANSFORMS].log(self._transform[0], log_time=self._transform[1])

    def _report(self, feed: socket.socket, before: str) -> str:
        now = json.dumps({"viewers": self._subscriptions.viewers, "slow": self._messages.slow})
        if now != before:
            # one that does not fit is followed by another
            with contextlib.suppress(OSError):
                feed.send(now.encode())
        return now


def _channel(topic: str, typename: str) -> "Channel":
    import foxglove

    schema = foxglove.Schema(name=typename, encoding="ros2msg", data=schemas.definition(typename).encode())
    told = schemas.CHANNEL_METADATA.get(topic, {})
    return foxglove.Channel(topic, message_encoding="cdr", schema=schema, metadata=told)


def _refusal(host: str, port: int, error: Exception) -> str:
    code = getattr(error, "errno", None)
    if code == errno.EADDRINUSE:
        taken = f"port {port}, where Foxglove is to be served, is in use at {host}, maybe by another acquisition"
        return f"{taken}. Name another: --foxglove {port % 65535 + 1}."
    if code == errno.EADDRNOTAVAIL or isinstance(error, socket.gaierror):
        return f'"{host}" is no address of this computer: Foxglove cannot be served there. --foxglove-host names one.'
    return f"Foxglove cannot be served at {host}, port {port}: {error}. --foxglove and --foxglove-host name others."


def _received(feed: socket.socket) -> bytes:
    """Return the next message, or nothing once the acquisition has ended; it may have left reports unread."""
    try:
        return feed.recv(MESSAGE_LIMIT)
    except ConnectionResetError:
        return b""


def _tell(feed: socket.socket, document: dict[str, str]) -> None:
    with contextlib.suppress(OSError):
        feed.send(json.dumps(document).encode())


if __name__ == "__main__":
    code = main()
    # threads of the library are not waited for
    os._exit(code)
