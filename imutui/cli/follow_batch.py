"""Following the acquisitions of a batch from a terminal, all at once: what `record --batch` does while they run."""

import contextlib
import queue
import signal
import sys
import textwrap
import threading
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NoReturn

import typer
from rich.console import Console
from rich.live import Live
from rich.text import Text

from filters.errors import InputError
from imutui import batch_file
from imutui.batch_file import Batch
from imutui.cli import follow_acquisition
from imutui.cli.each_log import width
from imutui.cli.exit_codes import (
    FINDINGS,
    FINE,
    INSTRUMENT,
    INTERRUPTED,
    USAGE,
    fail,
    handling,
    print_json,
    say,
    say_if_not_kept,
    show_progress,
    tell,
)
from imutui.cli.follow_acquisition import HungUpError, TerminatedError
from imutui.cli.session_options import refuse
from imutui.command_line import command
from imutui.plain_text import in_line, one_line
from imutui.session import batch as batches
from imutui.session import client
from imutui.session.client import Client, EndReport, SessionError, SessionGoneError
from imutui.session.lifecycle import failed
from imutui.session.plan import Plan, batch_of
from imutui.session.snapshot import NO_SERIES
from imutui.settings import SETTINGS
from imutui.verdict import sources

_LOOK_S = 1.0


def end_of(name: str, stopped: EndReport | SessionError) -> EndReport:
    """Return the end of an acquisition that was asked to stop; `exit_code` is what the command makes of it."""
    if isinstance(stopped, SessionError):
        say(f"imutui: {name}: {stopped}")
        return failed(name, stopped.exit_code, str(stopped))
    return {**stopped, "exit_code": follow_acquisition.verdict(stopped)}


def tell_ends(ends: Sequence[EndReport], *, json: bool) -> int:
    """Print the ends of units; returns the worst exit code."""
    if json:
        print_json(ends)
    else:
        tell("\n".join(map(_text, ends)))
    return max((end["exit_code"] for end in ends), default=FINE)


def _text(end: EndReport) -> str:
    """Return the unit, its verdict or error, and its file on a line of its own, left whole so that it can be copied."""
    result, said = end["result"], end["error"] or "nothing was recorded"
    if result is not None:
        said = f"{sources.hence(result)}; {result['samples']} samples, {result['lost_packets']} lost"
    lines = textwrap.wrap(f"{end['name']}: {said}", width(), subsequent_indent="    ")
    return "\n".join([*lines, *([f"    {result['log']}"] if result is not None else [])])


class Follower:
    """Starts units and waits for their ends, and for those of units that are started beside them in the batch."""

    def __init__(self, batch: Batch, base: Plan) -> None:
        self.batch, self._base = batch, base
        self._prefix = batches.acquisition_of(batch.name, "")
        self.ends: list[EndReport] = []
        self.terminated = False
        self._over = queue.SimpleQueue[tuple[Client, Any]]()
        self._here: dict[str, Client] = {}  # those that run, by their names

    def start(self, plans: Sequence[Plan]) -> None:
        """Start units; say of each whether it runs."""
        show_progress("" if all(plan.port for plan in plans) else "units are looked for by their numbers")
        batches.start(self.batch, plans, self._begun)

    def _begun(self, plan: Plan, outcome: Client | SessionError) -> None:
        if isinstance(outcome, SessionError):
            self._did_not_begin(plan.name, outcome)
            return
        self._join(outcome)
        with contextlib.suppress(SessionError):  # it ended at once: its end is told
            follow_acquisition.say_begun(plan, outcome)

    def _did_not_begin(self, name: str, error: SessionError) -> None:
        say(f"imutui: {name}: {error} {self._again(name)}")
        self.ends.append(failed(name, error.exit_code, str(error)))

    def _again(self, name: str) -> str:
        unit = name.removeprefix(self._prefix)
        again = command("record", "--batch", self.batch.path, "--name", unit)
        return f"When it is put right: `{again}`, with --port if it is at another port by then."

    def _join(self, connection: Client) -> None:
        self._here[connection.name] = connection
        threading.Thread(target=self._wait, args=(connection,), daemon=True).start()

    def _wait(self, connection: Client) -> None:
        try:
            self._over.put((connection, connection.wait()))
        except (SessionError, OSError) as error:
            self._over.put((connection, error))

    def follow(self) -> None:
        """Wait until all have ended."""
        with _shown(self._lines) as show:
            while self._here:
                try:
                    self._ended(*self._over.get(timeout=_LOOK_S))
                except queue.Empty:
                    self._find_others()
                show()

    def _find_others(self) -> None:
        """Follow what was started in the batch since: a unit that is there again, or another in its place."""
        for name in client.running():
            if batch_of(name) == self.batch.name and name not in self._here:
                with contextlib.suppress(SessionError):  # it is connecting; soon it is not
                    self._join(Client(name))
                    say(f"{name} runs again" if any(end["name"] == name for end in self.ends) else f"{name} runs, too")

    def _ended(self, connection: Client, outcome: EndReport | SessionError | OSError) -> None:
        name = connection.name
        del self._here[name]
        if isinstance(outcome, Exception):
            code = FINDINGS if isinstance(outcome, SessionGoneError) else getattr(outcome, "exit_code", FINDINGS)
            end = failed(name, code, str(outcome))
            say(f"imutui: {name}: {outcome} {self._again(name)}")
        else:
            if outcome["result"] is None:
                end = failed(name, FINDINGS, "it ended without a recording")
            else:
                code = follow_acquisition.exit_code(self._base, outcome, self.terminated)
                end = {**outcome, "exit_code": code}
            by = "" if self.terminated or outcome["by_itself"] else f", ended by {outcome['ended_by']}"
            say(f"{name} has ended{by}; {len(self._here)} running")
        self.ends.append(end)

    def stop(self, by: str) -> None:
        """Have all of them finish their files, all at once, and wait for that."""
        for name, outcome in batches.each(list(self._here), lambda connection: connection.stop(by)).items():
            if isinstance(outcome, SessionError) and name in client.running():
                self._did_not_end(name)
        while self._here:
            self._ended(*self._over.get())

    def _did_not_end(self, name: str) -> None:
        said = f"it does not end; `kill -9 {self._here.pop(name).pid}` does. What was recorded is on the disk"
        say(f"imutui: {name}: {said}")
        self.ends.append(failed(name, INSTRUMENT, said))

    def left(self) -> str:
        """What is said of those that do not end."""
        pids = " ".join(str(connection.pid) for connection in self._here.values())
        return f"{', '.join(self._here)} do not end; `kill -9 {pids}` does"

    def _lines(self) -> str:
        """A unit a line."""
        order = [unit.name for unit in self.batch.units]
        answers = [batches.answer_of(one.name, partial(one.snapshot, since=NO_SERIES)) for one in self._here.values()]
        units = {one.name.removeprefix(self._prefix): one for one in answers}
        units = dict(sorted(units.items(), key=lambda row: order.index(row[0]) if row[0] in order else len(order)))
        widest = max(map(len, units), default=0)
        rows = [
            f"{unit:<{widest}}  {follow_acquisition.line(one.snapshot) if one.snapshot else one.missing}"
            for unit, one in units.items()
        ]
        head = f"{len(rows)} running: Ctrl+C finishes all, `{command('attach', '--batch', self.batch.name)}` shows more"
        return "\n".join(map(in_line, [head, *rows]))


@contextlib.contextmanager
def _shown(lines: Any) -> Iterator[Any]:
    """What shows the units on a terminal that is one."""
    if not sys.stderr.isatty():
        yield lambda: None
        return
    with Live(console=Console(stderr=True), auto_refresh=False, transient=True) as live:
        yield lambda: live.update(Text(lines(), no_wrap=True, overflow="ellipsis"), refresh=True)


class _Signals:
    """SIGTERM ends all, SIGHUP leaves them to themselves, once what is on its way up is up."""

    def __init__(self) -> None:
        self._hung_up, self._may_leave = False, False

    def terminate(self, *_: object) -> None:
        raise TerminatedError

    def hang_up(self, *_: object) -> None:
        self._hung_up = True
        if self._may_leave:
            raise HungUpError

    def may_leave(self) -> None:
        self._may_leave = True
        if self._hung_up:
            raise HungUpError


def follow(batch: Batch, base: Plan, plans: Sequence[Plan], *, json: bool) -> NoReturn:
    """Start the acquisitions of a batch, show them until all have ended, print their results, and exit.

    `base`: of which the plans are made.
    `plans`: of what is to be started.
    """
    follower, signals, interrupted = Follower(batch, base), _Signals(), False
    handlers = {signal.SIGTERM: signals.terminate, signal.SIGHUP: signals.hang_up}
    try:
        with handling(handlers):
            try:
                follower.start(plans)
                signals.may_leave()
                follower.follow()
            except (KeyboardInterrupt, TerminatedError) as error:
                interrupted = isinstance(error, KeyboardInterrupt)
                follower.terminated = True
                follower.stop("Ctrl+C in imutui record" if interrupted else "SIGTERM to imutui record")
                told = {end["name"] for end in follower.ends}
                early = [plan.name for plan in plans if plan.name not in told]
                follower.ends += [failed(name, FINE, follow_acquisition.ENDED_EARLY) for name in early]
    except TerminatedError:
        raise SessionError(follower.left()) from None
    except HungUpError:
        raise typer.Exit(FINE) from None
    order = [plan.name for plan in plans]
    ends = sorted(follower.ends, key=lambda end: order.index(end["name"]) if end["name"] in order else len(order))
    code = tell_ends(ends, json=json)
    if any(end["result"] for end in ends):
        report = command("report", "--batch", batch.name, "-o", Path(batch.name))
        say(f"`{report}` tells which units pass, and what they have in common")
    raise typer.Exit(INTERRUPTED if interrupted else code)


def record(path: Path, name: str | None, port: str | None, base: Plan, given: Sequence[str], *, json: bool) -> NoReturn:
    """Record the units of a batch's file that are chosen and do not run yet, and exit.

    `name`, `port`: units that are chosen, with commas between them, None for all; where the one that is chosen is now.
    `given`: fields of `base` that the command line states. They win over the file, and over what the batch began with.
    """
    batch = batch_file.read(path)
    first = batches.asked_of(batch.name) if batch.name in batches.running() else None
    if first is None:
        keys = [_KEYS.get(field, field) for field in given]
        unstated: dict[str, Any] = dict.fromkeys(key for key in keys if key in batch_file.COMMON)
        batch = replace(batch, **unstated)
        common = batches.base_of(batch, base)
    else:
        own: dict[str, Any] = {field: getattr(base, field) for field in given}
        common = replace(first, **own)
    plans = batches.plans(batch, common)
    remarks = dict[str, None]()
    for number, plan in enumerate(plans, 1):
        try:
            remarks |= dict.fromkeys(refuse(plan))
        except InputError as error:
            raise batch.wrong(f"[[unit]] {number}: {error}") from error
    of = {plan.name: plan for plan in plans}
    wanted = [*of] if name is None else [batches.acquisition_of(batch.name, each) for each in name.split(",")]
    for each in wanted:
        if each not in of:
            known = ", ".join(unit.name for unit in batch.units)
            raise fail(USAGE, f'{path} has no unit "{each.partition(":")[2]}"; it has: {known}.')
    runs = [each for each in wanted if each in client.running()]
    for each in runs:
        say(f"{each} runs already and is left alone; `{command('stop', '--name', each)}` ends it")
    asked = [of[each] for each in wanted if each not in runs]
    if not asked:
        raise fail(INSTRUMENT, f"all of it runs already; `{command('stop', '--batch', batch.name)}` ends it.")
    if port is not None:
        asked = [replace(plan, port=port) for plan in asked]
    say_if_not_kept()
    if first is not None:
        say(f"{', '.join(plan.name for plan in asked)}: as the batch began, {_in_words(common)}")
        for field in given:
            if field != "reference_file" and getattr(common, field) != getattr(first, field):
                flag = _FLAGS.get(field) or f"--{field.replace('_', '-')}"
                said, others = (_value(getattr(plan, field)) for plan in (common, first))
                say(f"{flag} {said} is of this command; the batch began with {others}")
    for remark in remarks:
        say(remark)
    batches.begin(batch, first or common)
    follow(batch, common, asked, json=json)


_KEYS = {"rate_hz": "rate", "reference": "profile"}
"""Keys of a batch's file for fields of a plan, where their names differ."""
_FLAGS = {each.name: each.setting.flag for each in SETTINGS.values()} | {"duration_s": "--duration"}
"""Options for fields of a plan, where their names differ."""
_LONGEST_VALUE = 60


def _in_words(plan: Plan) -> str:
    """What a plan asks of all units of a batch."""
    parts = [f"{plan.rate_hz:g} Hz" if plan.rate_hz else "the unit's own rate", plan.sampling, f"filter {plan.filter}"]
    parts.append(f"reference {plan.reference_file[0] or plan.reference}")
    texts = ("note", "operator", "place", "table")
    parts += [f'{key} "{value}"' for key in texts if (value := getattr(plan, key))]
    if plan.duration_s is not None:
        parts.append(f"for {plan.duration_s:g} s")
    return ", ".join(parts)


def _value(value: object) -> str:
    text = f"{value:g}" if isinstance(value, float) else str(value)
    return one_line(text, _LONGEST_VALUE) if value not in (None, "") else "none"
