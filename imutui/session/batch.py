"""The acquisitions of a batch, each a process with a log of its own: which there are, how they are, one request to all.

The acquisition of a unit is called `BATCH:UNIT`. Beside the sockets a record of each batch names its file, so that
viewers know of units that are not there, too.
"""

import contextlib
import json
import os
import select
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

from filters.errors import InputError
from imutui import batch_file
from imutui.batch_file import Batch, BatchError, Unit
from imutui.command_line import command
from imutui.instrument.names import DEFAULT, VIRTUAL_PORT
from imutui.logbook import atomic_file
from imutui.session import client, ipc, lifecycle
from imutui.session.client import Client, SessionError, Starting
from imutui.session.lifecycle import EndReport
from imutui.session.plan import Plan, batch_of
from imutui.session.processes import Parent
from imutui.session.snapshot import NO_SERIES, ProbeAnswer, Snapshot

CONNECTING, SILENT, ENDED = "connecting", "does not answer", "ended"
_SUFFIX = ".batch"
_AT_ONCE = 32
_STARTING = max(4, os.cpu_count() or 1)
R = TypeVar("R")


@dataclass(frozen=True, slots=True)
class Answer:
    """The answer of an acquisition, or why there is none."""

    name: str
    snapshot: Snapshot | None  # without series; None if there is none to be had
    missing: str = ""  # why there is no snapshot: CONNECTING, SILENT or ENDED
    unit: Unit | None = None  # of the batch's file, if it is in there
    report: EndReport | None = None  # of one that has ended, if it left one

    @property
    def why(self) -> str:
        """Why the acquisition has ended, in words; empty if it runs."""
        if self.missing != ENDED:
            return ""
        if self.report is None:
            return "it left no word: not started yet, or killed. What was recorded is on the disk"
        ended_by = self.report["ended_by"]
        return self.report["error"] or (f"ended by {ended_by}" if ended_by else "it ended by itself")


def acquisition_of(batch: str, unit: str) -> str:
    """Return the name of the acquisition of a unit; a name of an acquisition stays as it is."""
    return unit if batch_of(unit) == batch else f"{batch}:{unit}"


def base_of(batch: Batch, base: Plan) -> Plan:
    """Return the plan that all units of a batch have in common.

    `base`: fields that the file does not state.
    Raises BatchError if the file names a profile that cannot be read.
    """
    from imutui.logbook import import_reference

    stated = {key: getattr(batch, key) for key in ("filter", "note", "operator", "table", "place")}
    common: dict[str, Any] = {key: value for key, value in stated.items() if value is not None}
    if batch.rate is not None:
        common |= {"rate_hz": batch.rate}
    try:
        if batch.profile is not None:
            file = import_reference.from_text(batch.profile)
            if file is None:
                raise InputError(f'`profile` is "{batch.profile}", no .toml or .csv file nor a ready-made profile')
            name = import_reference.name_of(batch.profile)
            common |= {"reference": file.kind, "reference_file": (name, file.content.decode("utf-8-sig"))}
        return replace(base, **common)
    except InputError as error:
        raise batch.wrong(str(error)) from error


def plans(batch: Batch, base: Plan) -> list[Plan]:
    """Return the plans of the units' acquisitions, in their order; a unit known by its serial number has no port yet.

    `base`: what `base_of` returned.
    Raises BatchError with file, unit and key if a plan cannot be, or a file that it names can't be read.
    """
    from imutui.logbook import effects_file

    which, found = "", []
    try:
        for number, unit in enumerate(batch.units, 1):
            which = f"[[unit]] {number}: "
            own: dict[str, Any] = {"name": acquisition_of(batch.name, unit.name), "port": unit.port}
            if base.foxglove_port:
                own["foxglove_port"] = base.foxglove_port + number - 1
            if unit.instrument or unit.port == VIRTUAL_PORT:
                own["instrument"] = unit.instrument or DEFAULT
            if unit.port == VIRTUAL_PORT:
                own["virtual"] = ("--instrument", own["instrument"], "--seed", str(number))
            if unit.mount:
                own["mount"] = unit.mount
            if unit.effects:
                own["effects"] = effects_file.from_file(Path(unit.effects)).decode("utf-8-sig")
            found.append(replace(base, **own))
    except InputError as error:
        raise batch.wrong(f"{which}{error}") from error
    return found


def find(serials: Sequence[str]) -> dict[str, str | SessionError]:
    """Return the port of each serial number, or the error; all ports that no acquisition has are probed at once.

    It takes some seconds where a port does not answer.
    """
    answers = [answer for _, answer in _at_once([port for port, _ in client.ports()], client.probe)]
    has = [one.snapshot for one in ask(client.running()) if one.snapshot is not None]
    out: dict[str, str | SessionError] = {}
    for serial in serials:
        at = [answer["port"] for answer in answers if answer["answers"] and answer["serial_number"] == serial]
        owner = next((seen["name"] for seen in has if seen["serial_number"] == serial), None)
        if owner is not None:
            out[serial] = SessionError(f'the unit {serial} is recorded already, by the acquisition "{owner}"')
        elif len(at) == 1:
            out[serial] = at[0]
        elif at:
            out[serial] = SessionError(f"{serial} answers on {' and on '.join(at)}; write `port` instead of `serial`")
        else:
            told = ", ".join(f"{answer['port']} ({_told(answer)})" for answer in answers) or "there is no port to ask"
            out[serial] = SessionError(f"no unit with the serial number {serial} answers: {told}")
    return out


def _told(answer: ProbeAnswer) -> str:
    return answer["serial_number"] or "a unit without a number" if answer["answers"] else "no answer"


def start(batch: Batch, asked: Sequence[Plan], begun: Callable[[Plan, Client | SessionError], None]) -> None:
    """Start units of a batch, those first whose port is known; `begun` is called with the client or error of each.

    `asked`: of `plans`. Several are forked from one process, so that they share what they load.
    A unit that does not start keeps no other from it. An exception of `begun` gives up those on their way up.
    """
    serials = {acquisition_of(batch.name, unit.name): unit.serial for unit in batch.units}
    filters, effects = any(plan.filter != "none" for plan in asked), any(plan.effects for plan in asked)
    with Parent(filters=filters, effects=effects) if len(asked) > 1 else contextlib.nullcontext() as parent:
        _start([plan for plan in asked if plan.port], begun, parent)
        sought, ready = [plan for plan in asked if not plan.port], list[Plan]()
        found = find([serials[plan.name] for plan in sought]) if sought else {}
        for plan in sought:
            port = found[serials[plan.name]]
            if isinstance(port, SessionError):
                lifecycle.write_end(lifecycle.failed(plan.name, port.exit_code, str(port)))
                begun(plan, port)
            else:
                ready.append(replace(plan, port=port))
        _start(ready, begun, parent)


def _start(asked: Sequence[Plan], begun: Callable[[Plan, Client | SessionError], None], parent: Parent | None) -> None:
    """Start acquisitions, some at a time, each when it is its turn."""
    waiting, coming = [*asked], list[Starting]()
    try:
        while waiting or coming:
            while waiting and len(coming) < _STARTING:
                try:
                    coming.append(Starting(waiting[0], parent=parent))
                except ConnectionError:  # the process that the others were forked from hangs, or was killed
                    parent = None
                    continue
                del waiting[0]
            left_s = min(one.deadline for one in coming) - time.monotonic()
            ready, _, _ = select.select(coming, [], [], max(0.0, left_s))
            first = ready[0] if ready else min(coming, key=lambda one: one.deadline)
            outcome: Client | SessionError
            try:
                outcome = first.client()
            except SessionError as error:
                outcome = error
            begun(first.plan, outcome)
            coming.remove(first)
    finally:
        for one in coming:
            one.give_up()


def begin(batch: Batch, base: Plan) -> None:
    """Record the file of a batch for viewers, and the plan of all its units for those that join later.

    `base`: what `base_of` returned.
    """
    record = json.dumps([str(batch.path.resolve()), base.dumps()])
    atomic_file.write(ipc.folder() / f"{batch.name}{_SUFFIX}", record, overwrite=True)


def _begun(name: str) -> tuple[Path, str] | None:
    """Return the file and the text of the plan of the batch that was begun last by that name; None if there is none."""
    records = [folder / f"{name}{_SUFFIX}" for folder in ipc.folders()]
    record = next((path for path in records if path.exists()), None)
    if record is None:
        return None
    file, plan = json.loads(record.read_text(encoding="utf-8"))
    return Path(file), plan


def asked_of(name: str) -> Plan | None:
    """Return the plan of all units of the batch that was begun last; None if there is none.

    Raises SessionError if another version of this program wrote it.
    """
    begun = _begun(name)
    try:
        return None if begun is None else Plan.loads(begun[1])
    except (KeyError, TypeError, ValueError) as error:
        stop = command("stop", "--batch", name)
        said = f"another version of imutui started the batch {name}: `{stop}`, then start all of it"
        raise SessionError(said) from error


def file_of(name: str) -> Path | None:
    """Return the file of the batch of that name that was begun last; None if there is none, or it has gone."""
    begun = _begun(name)
    return None if begun is None or not begun[0].exists() else begun[0]


def running() -> list[str]:
    """Return the names of the batches of which a unit is being acquired."""
    return sorted({*map(batch_of, client.running())} - {""})


def names(batch: str) -> list[str]:
    """Return the names of a batch's acquisitions that run; raises SessionError if none does."""
    here = client.running()
    found = [name for name in rows(batch) if name in here]
    if not found:
        others = f" Running: {', '.join(running())}." if running() else ""
        said = f'no unit of a batch "{batch}" is running.{others} `imutui record --batch FILE` starts one.'
        raise SessionError(said, lifecycle.INSTRUMENT)
    return found


def rows(batch: str) -> dict[str, Unit | None]:
    """Return the names of a batch's acquisitions: those of its file in order, running or not, then others that run."""
    path, found = file_of(batch), dict[str, Unit | None]()
    with contextlib.suppress(BatchError):  # it is being changed; what runs is known without it
        read = batch_file.read(path) if path is not None else None
        found = {acquisition_of(batch, unit.name): unit for unit in read.units} if read is not None else {}
    others = [name for name in client.running() if batch_of(name) == batch and name not in found]
    return found | dict.fromkeys(others)


def units(batch: str) -> list[Answer]:
    """Return the answers of the units of a batch, in the order of `rows`."""
    found = rows(batch)
    return [replace(each, unit=found[each.name]) for each in ask(found)]


def ask(acquisitions: Iterable[str]) -> list[Answer]:
    """Return the answers of acquisitions, asked all at once; one that hangs or connects delays no other's answer."""

    def asked(name: str) -> Answer:
        def look() -> Snapshot:
            with contextlib.closing(client.attach(name)) as connection:
                return connection.snapshot(since=NO_SERIES)

        return answer_of(name, look)

    return [found for _, found in _at_once(list(acquisitions), asked)]


def each(acquisitions: Sequence[str], do: Callable[[Client], R]) -> dict[str, R | SessionError]:
    """Call a function with a client of each acquisition, all at once; return its result or error of each."""

    def done(name: str) -> R | SessionError:
        try:
            with contextlib.closing(client.attach(name)) as connection:
                return do(connection)
        except SessionError as error:
            return error
        except TimeoutError:
            return SessionError(f'the acquisition "{name}" does not answer')

    return dict(_at_once(acquisitions, done))


def _at_once(acquisitions: Sequence[str], do: Callable[[str], R]) -> list[tuple[str, R]]:
    if not acquisitions:
        return []
    with ThreadPoolExecutor(min(_AT_ONCE, len(acquisitions))) as pool:
        return list(zip(acquisitions, pool.map(do, acquisitions), strict=True))


def answer_of(name: str, look: Callable[[], Snapshot]) -> Answer:
    """Return the answer of an acquisition; `look` asks it for a snapshot."""
    try:
        return Answer(name, look())
    except client.SessionConnectingError:
        return Answer(name, None, CONNECTING)
    except SessionError:
        if name in client.running():
            return Answer(name, None, SILENT)
        return Answer(name, None, ENDED, report=lifecycle.read_end(name))
