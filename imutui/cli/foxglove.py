"""`imutui foxglove`."""

import contextlib
import importlib.util
import signal
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from imutui.cli.exit_codes import FINDINGS, FINE, USAGE, fail, lacking, say
from imutui.cli.options import Name

if TYPE_CHECKING:
    from imutui.foxglove_server import FoxgloveServer
    from imutui.session.client import Client

_PORT = 8765
_CONNECTS_S = 0.2


def command(
    log: Annotated[
        Path | None, typer.Argument(metavar="[LOG]", help="Log; those of the running acquisition unless given.")
    ] = None,
    port: Annotated[
        int | None, typer.Option("--port", metavar="N", help=f"TCP port; foxglove.port, or {_PORT}, unless given.")
    ] = None,
    host: Annotated[
        str | None,
        typer.Option("--host", metavar="ADDR", help="Address to serve at; 127.0.0.1, this computer, unless given."),
    ] = None,
    name: Name = None,
) -> None:
    """Serve a log to Foxglove, over a websocket.

    A log that is being recorded is served as it grows, each second, from now on. Without LOG these are the logs of the
    running acquisition, one after the other, until it ends. The acquisition does not depend on this command: its end,
    or a crash, costs viewers their stream and nothing else. `imutui record --foxglove PORT` starts this command.

    Any other log is played once, in its own time, from the moment at which a viewer subscribes. Foxglove also opens the
    file itself, with a time line.

    Example: imutui foxglove --port 8765
    """
    from imutui import config
    from imutui.foxglove_server import FoxgloveServer
    from imutui.origin_gate import url

    if log is not None and name is not None:
        raise fail(USAGE, "LOG is one file, --name an acquisition and its files; give one of the two.")
    settings = config.load()
    host = host or settings.text("foxglove.host")
    port = port or int(settings.number("foxglove.port")) or _PORT
    check(host)
    source = _acquisition(name) if log is None else log
    title = f"imutui {source.name}"
    stop = threading.Event()
    # a thread sets it, since the signal may interrupt what holds the event's own lock
    signal.signal(signal.SIGTERM, lambda *_: threading.Thread(target=stop.set).start())
    origins = frozenset(settings.text("foxglove.origins").lower().split())
    with contextlib.closing(FoxgloveServer(host, port, title, origins, stop)) as server:
        say(f"{title} is served to Foxglove at {url(host, port)}; Ctrl+C ends it")
        damaged = _serve(server, source) if isinstance(source, Path) else _follow(server, source, stop)
    raise typer.Exit(FINDINGS if damaged else FINE)


def check(host: str) -> None:
    """Refuse to serve without the library; warn if other computers can reach the address."""
    if importlib.util.find_spec("foxglove") is None:
        raise lacking("a stream for Foxglove needs foxglove-sdk", "live")
    if not (host.startswith("127.") or host in ("localhost", "::1")):
        say(
            f"imutui: the stream for Foxglove is served at {host}: anyone who reaches this computer can watch,"
            " without a password and unencrypted"
        )


def _acquisition(name: str | None) -> "Client":
    """Return a running acquisition, once it has connected to its instrument; it is looked at no longer."""
    from imutui.session import client

    while True:
        try:
            with contextlib.closing(client.attach(name)) as found:
                return found
        except client.SessionConnectingError:
            time.sleep(_CONNECTS_S)


def _follow(server: "FoxgloveServer", acquisition: "Client", stop: threading.Event) -> bool:
    """Serve the logs of an acquisition until it ends; return whether one is damaged."""
    from imutui.foxglove_server import LOOK_S
    from imutui.logbook.reader import UnreadableLogError
    from imutui.session.processes import Process, open_logs

    process, from_now, damaged = Process(acquisition.pid), True, False
    while True:
        over = stop.wait(LOOK_S) or process.has_ended()
        for log in open_logs(process.pid):
            # it has just been made, and is empty yet
            with contextlib.suppress(UnreadableLogError):
                damaged |= _serve(server, log, from_now=from_now)
        from_now = False
        if over:
            return damaged


def _serve(server: "FoxgloveServer", log: Path, *, from_now: bool = True) -> bool:
    """Serve a log to its end; report damage, and return whether there is any."""
    from imutui import command_line

    damage = server.serve(log, from_now=from_now)
    if damage is not None:
        said = f"{log} was served up to byte {damage.offset}, where {damage.why}"
        say(f"imutui: {said}. `{command_line.command('check', log)}` shows what is damaged.")
    return damage is not None
