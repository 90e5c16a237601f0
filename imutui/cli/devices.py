"""`imutui devices`."""

from collections.abc import Collection
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Annotated, Any, TypeAlias

import typer

from imutui.cli.exit_codes import FINDINGS, FINE, INSTRUMENT, answer, check_output, fail, say, show_progress
from imutui.cli.options import Force, Json

Entry: TypeAlias = dict[str, Any]
"""Of the JSON: a port, and what answers there if it was asked (`session.snapshot.ProbeAnswer`); or an acquisition."""
_OF_ACQUISITION = ("name", "port", "instrument", "serial_number", "kind", "state")


def command(
    ports: Annotated[
        list[str] | None, typer.Argument(metavar="[PORT...]", help="Ports to probe, listed by the system or not.")
    ] = None,
    probe: Annotated[bool, typer.Option("--probe", help="Ask each port who is there; stops a stream.")] = False,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Write the units that answer as a batch, for record --batch.")
    ] = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """List serial ports by their stable id, and which acquisitions have one.

    With --probe each is asked: ping, version, serial number. A port that an acquisition has is left alone. With -o the
    units are written as a table, to be recorded at once by imutui record --batch, and to be changed by hand before:
    by serial number, or by port where there is none or the system does not list the port.

    Exit code 0, or 1 if a port that was asked does not answer.

    Example: imutui devices --probe
    """
    from imutui.document_shape import VERSION
    from imutui.session import client

    if output is not None:
        check_output(output, force)
    running = _running()
    known = dict(client.ports())
    found: list[Entry] = [{"port": name, "description": known[name]} for name in known if not ports or name in ports]
    found += [{"port": name, "description": ""} for name in ports or () if name not in known]
    if probe or ports or output is not None:
        show_progress(f"asking {', '.join(entry['port'] for entry in found)}")
        with ThreadPoolExecutor(max(1, len(found))) as pool:
            for entry, told in zip(found, pool.map(client.probe, [entry["port"] for entry in found]), strict=True):
                entry.update(told)
    answer({"version": VERSION, "ports": found, "acquisitions": running}, lambda: _text(found, running), json=json)
    if output is not None:
        _write(output, [entry for entry in found if entry["answers"]], known, force)
    raise typer.Exit(FINDINGS if any(not entry.get("answers", True) for entry in found) else FINE)


def _write(output: Path, units: list[Entry], listed: Collection[str], force: bool) -> None:
    """Write the table of a batch."""
    from imutui import command_line
    from imutui.batch_file import Batch, Unit, to_toml
    from imutui.jobs.quantities import plural
    from imutui.logbook import atomic_file
    from imutui.session.snapshot import unit_in_words

    if not units:
        raise fail(INSTRUMENT, f"no unit answers, so {output} is not written.")
    numbers = [entry["serial_number"] for entry in units]
    rows, about = list[Unit](), list[str]()
    for number, entry in enumerate(units, 1):
        serial = entry["serial_number"] if numbers.count(entry["serial_number"]) == 1 else ""
        # by a number units are looked for at the ports that the system lists
        by_number = bool(serial) and entry["port"] in listed
        rows.append(Unit(serial or str(number), *(("", serial) if by_number else (entry["port"], ""))))
        unit = unit_in_words(entry["instrument"], entry["serial_number"])
        about.append(". ".join(filter(None, (f"{unit} at {entry['port']}", entry["error"]))))
    atomic_file.write(output, to_toml(Batch(output, tuple(rows)), tuple(about)), overwrite=force)
    record = command_line.command("record", "--batch", output)
    say(f"imutui: {output}: {plural(len(rows), 'unit')}; `{record}` records them")


def _running() -> list[Entry]:
    """Acquisitions of this user: name, port, instrument, state; those on their way up by name only."""
    from imutui.session import client
    from imutui.session.batch import ENDED, ask

    out: list[Entry] = []
    for one in ask(client.running()):
        if one.snapshot is not None:
            state: Entry = {**one.snapshot}
            out.append({key: state[key] for key in _OF_ACQUISITION} | {"recording": state["recording"] is not None})
        elif one.missing != ENDED:
            out.append({"name": one.name, "state": "connecting"})
    return out


def _text(found: list[Entry], running: list[Entry]) -> str:
    lines = [] if found else ["no serial port on this machine. Plug the adapter in; `imutui demo` needs none."]
    for entry in found:
        about = f"  {entry['description']}" if entry["description"] else ""
        lines.append(f"{entry['port']}{about}")
        if "answers" in entry:
            lines.append(f"    {_answer(entry)}")
    for a in running:
        if "port" not in a:
            lines.append(f'acquisition "{a["name"]}" is connecting to its instrument')
            continue
        what = "recording" if a["recording"] else "not recording"
        unit = f"{a['instrument']} #{a['serial_number']}" if a["serial_number"] else a["instrument"]
        lines.append(f'acquisition "{a["name"]}" has {a["port"]}: {unit}, {a["kind"]}, {a["state"]}, {what}')
    return "\n".join(lines)


def _answer(entry: Entry) -> str:
    if not entry["answers"]:
        return f"no answer: {entry['error']}"
    number = f" #{entry['serial_number']}" if entry["serial_number"] else ""
    told = f"{entry['instrument']}{number}, says {entry['firmware'] or 'nothing of its version'}, {entry['baud']} baud"
    return f"{told}. {entry['error']}" if entry["error"] else told
