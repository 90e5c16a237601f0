"""Following an acquisition from a terminal: what `record` and the headless demo do while it runs."""

import contextlib
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import typer
from rich.console import Console
from rich.live import Live
from rich.text import Text

from imutui.cli.each_log import width
from imutui.cli.exit_codes import FINDINGS, FINE, INTERRUPTED, answer, handling, say, say_if_not_kept
from imutui.estimates import live_biases
from imutui.logbook.log_time import Timebase
from imutui.plain_text import in_line
from imutui.report import replay_text
from imutui.session import client
from imutui.session.client import Client, EndReport, SessionError, SessionGoneError
from imutui.session.plan import Plan, batch_of
from imutui.session.snapshot import NO_SERIES, Snapshot, not_said, unit_in_words
from imutui.tui.messages import lost, silence
from imutui.verdict import rules, sources
from imutui.verdict.rules import SITE_NOT_STATED

if TYPE_CHECKING:
    from imutui.logbook.results import RunDocument

_REFRESH_S, _PIECE_S = 0.25, 1.0
ENDED_EARLY = "ended before the first packet came: nothing was recorded"


class TerminatedError(Exception):
    """Somebody wants this program to end: SIGTERM."""


class HungUpError(Exception):
    """This terminal went away; the acquisition goes on."""


def follow(plan: Plan, *, json: bool, add: "Callable[[RunDocument], RunDocument]" = lambda document: document) -> None:
    """Start an acquisition, show it until it ends, print its result, and exit.

    `plan`: with `record` set.
    `add`: adds to the result document before it is printed.
    """
    interrupted, terminated = False, threading.Event()
    say_if_not_kept()
    connection = _started(plan)
    with _leave_on_hangup(connection, terminated):
        try:
            say_begun(plan, connection)
            end = _watch(connection)
        except KeyboardInterrupt:
            interrupted = True
            end = connection.stop("Ctrl+C in imutui record")
        except TerminatedError:
            raise SessionError(f'the acquisition "{plan.name}" does not end; `kill -9 {connection.pid}` does') from None
        except HungUpError:
            raise typer.Exit(FINE) from None
        except SessionGoneError as error:
            raise SessionError(str(error), FINDINGS) from error
    if end["result"] is None:
        raise SessionError("the acquisition ended without a recording")
    end["result"] = result = add(end["result"])
    answer(result, lambda: replay_text.text(result, width()), json=json)
    parts = result["parts"]
    if parts:
        say(f"recorded in {len(parts)} files, {parts[0]['log']} to {parts[-1]['log']}; this is the result of the last")
    if end["ended_by"] and not (interrupted or terminated.is_set() or end["by_itself"]):
        say(f"ended by {end['ended_by']}")
    if interrupted:
        say_findings(end)
        raise typer.Exit(INTERRUPTED)
    raise typer.Exit(exit_code(plan, end, terminated.is_set()))


def _started(plan: Plan) -> Client:
    """Start an acquisition; a signal that ends this program meanwhile ends both."""

    def end(*_: object) -> None:
        raise TerminatedError

    try:
        with handling({signal.SIGTERM: end}):
            return client.start(plan)
    except TerminatedError:
        say(ENDED_EARLY)
        raise typer.Exit(FINE) from None
    except KeyboardInterrupt:
        say(ENDED_EARLY)
        raise


def say_begun(plan: Plan, connection: Client) -> None:
    """Say which unit is recorded into which file."""
    seen = connection.snapshot(since=NO_SERIES)
    unit, rec = unit_in_words(seen["instrument"], seen["serial_number"]), seen["recording"]
    to = rec["path"] if rec else "nothing"
    say(f"acquisition {plan.name}, pid {connection.pid}, {unit} on {seen['port']}, recording to {to}")
    unsaid = not_said(seen["serial_number"], seen["firmware"])
    if unsaid is not None:
        say(unsaid)
    why = Timebase.now().why_moved()  # by the clock of this computer, as the acquisition has it
    if why:
        say(why)
    if seen["filter"] is not None and not seen["site_stated"]:
        say(SITE_NOT_STATED)


def exit_code(plan: Plan, end: EndReport, terminated: bool) -> int:
    """Return the exit code for an acquisition that did not fail; writes on stderr what led to it."""
    if plan.unattended:
        # a service is started again after an error, and must not be because a bias has not converged
        say_findings(end)
        code = FINE
    else:
        code = verdict(end)
    # a request for the end is `imutui stop` in another guise; only a command that follows to the end has its findings
    asked = terminated or (plan.unattended and not end["by_itself"])
    return code if asked else max([code, *(finding["exit_code"] for finding in end["findings"])])


def verdict(end: EndReport) -> int:
    """Return the exit code for an acquisition that was stopped, 0 or 1; writes on stderr what led to it."""
    say_findings(end)
    result = end["result"]
    parts = [] if result is None else result["parts"]
    if result is None:
        fine = True
    elif parts:
        # the last of several files is as short as chance has it, but what is RED is so however short
        fine = all(part["passes"] for part in parts[:-1]) and sources.of_document(result).level != "bad"
    else:
        fine = sources.of_document(result).passes
    if result is not None and not fine:
        say(f"{_whose(end)}{sources.hence(result)}, hence exit code 1; the recording itself is complete")
    return FINDINGS if end["findings"] or not fine else FINE


def say_findings(end: EndReport) -> None:
    """Write the findings of an acquisition that has ended on stderr."""
    for finding in end["findings"]:
        say(f"{_whose(end)}{finding['text']}")


def _whose(end: EndReport) -> str:
    """Return the name of a unit of a batch, as a prefix of messages."""
    return f"{end['name']}: " if batch_of(end["name"]) else ""


def _watch(connection: Client) -> EndReport:
    """Show the acquisition until it ends; returns the record of its end."""
    while not sys.stderr.isatty():
        # in pieces: a signal that comes just before a read that blocks is handled only when the read returns
        with contextlib.suppress(TimeoutError):
            return connection.wait(_PIECE_S)
    with Live(console=Console(stderr=True), refresh_per_second=4, transient=True) as live:
        while True:
            with contextlib.suppress(TimeoutError):
                return connection.wait(_REFRESH_S)
            live.update(Text(f"{in_line(line(connection.snapshot(since=NO_SERIES)))}   (Ctrl+C finishes)"))


def _stop(connection: Client) -> None:
    with contextlib.suppress(SessionError, TimeoutError):
        connection.stop("SIGTERM to imutui record")


def line(s: Snapshot) -> str:
    """How an acquisition is, in a line."""
    rec, fit = s["recording"], s["filter"]
    parts = [f"{s['measured_hz']:.2f} Hz" if s["measured_hz"] else "– Hz"]
    if rec is not None:
        part = f"part {rec['part']}, " if rec["part"] > 1 else ""
        parts.append(f"{part}{rec['seconds']:.0f} s, {rec['bytes'] / 1024:.0f} KiB")
    parts.append(f"lost {lost(s)}, bad checksums {s['bad_checksums']}")
    away = s["reconnecting"]
    if away is not None:
        parts.append(f"RECONNECTING for {away['seconds']:.0f} s, waits for {away['waits_for']}")
    elif silence(s) is not None:
        parts.append(f"SILENT for {s['silent_s']:.0f} s")
    if s["health"]:
        parts.append(rules.judge(None, s["health"]).fault.upper())
    if fit is not None:
        every = live_biases(fit)
        done, seen = sum(b.converged_s is not None for b in every), sum(b.observable for b in every)
        parts.append(fit["waiting"] or f"{done} of {seen} biases converged")
    return " · ".join(parts)


@contextlib.contextmanager
def _leave_on_hangup(connection: Client, terminated: threading.Event) -> Iterator[None]:
    """Leave the acquisition to itself on SIGHUP; end it on SIGTERM, which it may have got as well."""

    def leave(*_: object) -> None:
        raise HungUpError

    def end(*_: object) -> None:
        if terminated.is_set():
            raise TerminatedError
        terminated.set()
        # on a connection of its own: the one that waits for the end hears how it was, whoever asked first
        threading.Thread(target=_stop, args=(connection,), daemon=True).start()

    with handling({signal.SIGHUP: leave, signal.SIGTERM: end}):
        yield
