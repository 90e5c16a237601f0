"""`imutui status`."""

from typing import Any

from imutui.cli.options import Json, Name


def command(name: Name = None, json: Json = False) -> None:
    """Say what runs: each acquisition of yours, its instrument, file and state.

    Example: imutui status
    """
    from imutui.logbook.results import dumps
    from imutui.session import client

    names = [name] if name is not None else client.running()
    states = [client.attach(one).snapshot(since=2**62) for one in names]
    for state in states:
        del state["series"]
    if json:
        print(dumps(states))
    elif not states:
        print("no acquisition is running")
    for state in [] if json else states:
        print(_line(state))


def _line(s: dict[str, Any]) -> str:
    rec = s["recording"]
    file = f"recording to {rec['path']} ({rec['seconds']:.0f} s, {rec['bytes']} bytes)" if rec else "not recording"
    measured = f"{s['measured_hz']:.2f}" if s["measured_hz"] else "–"
    return (
        f"{s['name']} (pid {s['pid']}): {s['instrument']} #{s['serial_number']} on {s['port']}, {s['state']},"
        f" {s['kind']}, asked {s['rate_hz']:g} Hz measured {measured}, lost {s['lost_packets']},"
        f" bad checksums {s['bad_checksums']}, {file}"
    )
