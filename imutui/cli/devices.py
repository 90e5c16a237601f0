"""`imutui devices`."""

from typing import TYPE_CHECKING, Annotated, Required, TypedDict

import typer

from imutui.cli.options import Json

if TYPE_CHECKING:
    from imutui.session.snapshot import ProbeAnswer


class PortEntry(TypedDict, total=False):
    """A port, and what answers there if it was asked; see `session.snapshot.ProbeAnswer`."""

    port: Required[str]
    description: Required[str]
    answers: bool
    instrument: str
    serial_number: str
    firmware: str
    baud: int | None
    error: str | None


class AcquisitionEntry(TypedDict, total=False):
    """An acquisition of this user; one on its way up has a name and a state only."""

    name: Required[str]
    state: Required[str]
    port: str
    instrument: str
    serial_number: str
    kind: str
    recording: bool


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
    from imutui.cli.exit_codes import FINDINGS, FINE
    from imutui.session import client

    running = _running()
    known: list[PortEntry] = [{"port": name, "description": text} for name, text in client.ports()]
    found = [entry for entry in known if not ports or entry["port"] in ports]
    found += [{"port": name, "description": ""} for name in ports or () if name not in [p["port"] for p in found]]
    if probe or ports:
        found = [_with_answer(entry, _probed(entry["port"])) for entry in found]
    if json:
        from imutui.logbook.json_text import dumps

        print(dumps({"version": 1, "ports": found, "acquisitions": running}))
    else:
        _tell(found, running)
    raise typer.Exit(FINDINGS if any(not entry.get("answers", True) for entry in found) else FINE)


def _with_answer(entry: PortEntry, answer: "ProbeAnswer") -> PortEntry:
    return {**entry, **answer}


def _probed(port: str) -> "ProbeAnswer":
    from imutui.cli.exit_codes import show_progress
    from imutui.session import client

    show_progress(f"asking {port}")
    try:
        return client.probe(port)
    finally:
        show_progress("")


def _running() -> list[AcquisitionEntry]:
    """Acquisitions of this user: name, port, instrument, state; those on their way up by name only."""
    from imutui.session import client

    out: list[AcquisitionEntry] = []
    for name in client.running():
        try:
            found = client.attach(name)
            state = found.snapshot(since=2**62)
            found.close()
        except client.SessionError:
            out.append({"name": name, "state": "connecting"})
            continue
        out.append(
            {
                "name": state["name"],
                "port": state["port"],
                "instrument": state["instrument"],
                "serial_number": state["serial_number"],
                "kind": state["kind"],
                "state": state["state"],
                "recording": state["recording"] is not None,
            }
        )
    return out


def _tell(found: list[PortEntry], running: list[AcquisitionEntry]) -> None:
    from imutui.cli.exit_codes import tell

    if not found:
        tell("no serial port on this machine. Plug the adapter in; `imutui demo` needs none.")
    for entry in found:
        about = f"  {entry['description']}" if entry["description"] else ""
        tell(f"{entry['port']}{about}")
        if "answers" in entry:
            tell(f"    {_answer(entry)}")
    for a in running:
        if "port" not in a:
            tell(f'acquisition "{a["name"]}" is connecting to its instrument')
            continue
        what = "recording" if a["recording"] else "not recording"
        unit = f"{a['instrument']} #{a['serial_number']}" if a["serial_number"] else a["instrument"]
        tell(f'acquisition "{a["name"]}" has {a["port"]}: {unit}, {a["kind"]}, {a["state"]}, {what}')


def _answer(entry: PortEntry) -> str:
    if not entry["answers"]:
        return f"no answer: {entry['error']}"
    number = f" #{entry['serial_number']}" if entry["serial_number"] else ""
    told = f"{entry['instrument']}{number}, says {entry['firmware'] or 'nothing of its version'}, {entry['baud']} baud"
    return f"{told}. {entry['error']}" if entry["error"] else told
