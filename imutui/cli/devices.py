"""`imutui devices`."""

from typing import Annotated, Any, TypeAlias

import typer

from imutui.cli.exit_codes import FINDINGS, FINE, answer, show_progress
from imutui.cli.options import Json

Entry: TypeAlias = dict[str, Any]
"""Of the JSON: a port, and what answers there if it was asked (`session.snapshot.ProbeAnswer`); or an acquisition."""
_OF_ACQUISITION = ("name", "port", "instrument", "serial_number", "kind", "state")


def command(
    ports: Annotated[
        list[str] | None, typer.Argument(metavar="[PORT...]", help="Ports to probe, listed by the system or not.")
    ] = None,
    probe: Annotated[bool, typer.Option("--probe", help="Ask each port who is there; stops a stream.")] = False,
    json: Json = False,
) -> None:
    """List serial ports by their stable id, and which acquisitions have one.

    With --probe each is asked: ping, version, serial number. A port that an acquisition has is left alone.

    Exit code 0, or 1 if a port that was asked does not answer.

    Example: imutui devices --probe
    """
    from imutui.session import client

    running = _running()
    known = dict(client.ports())
    found: list[Entry] = [{"port": name, "description": known[name]} for name in known if not ports or name in ports]
    found += [{"port": name, "description": ""} for name in ports or () if name not in known]
    if probe or ports:
        for entry in found:
            show_progress(f"asking {entry['port']}")
            entry.update(client.probe(entry["port"]))
    answer({"version": 1, "ports": found, "acquisitions": running}, lambda: _text(found, running), json=json)
    raise typer.Exit(FINDINGS if any(not entry.get("answers", True) for entry in found) else FINE)


def _running() -> list[Entry]:
    """Acquisitions of this user: name, port, instrument, state; those on their way up by name only."""
    from imutui.session import client

    out: list[Entry] = []
    for name in client.running():
        try:
            found = client.attach(name)
            state: Entry = {**found.snapshot(since=2**62)}
            found.close()
        except client.SessionError:
            out.append({"name": name, "state": "connecting"})
            continue
        out.append({key: state[key] for key in _OF_ACQUISITION} | {"recording": state["recording"] is not None})
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
