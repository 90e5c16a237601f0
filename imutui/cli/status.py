"""`imutui status`."""

from typing import Any

from imutui.cli.options import Json, Name


def command(name: Name = None, json: Json = False) -> None:
    """Say which acquisitions run.

    For each: instrument, state, rate, losses, and the file it records to.

    Example: imutui status
    """
    from imutui.session import client

    names = [name] if name is not None else client.running()
    states, connecting = [], []
    for one in names:
        try:
            states.append(client.attach(one).snapshot(since=2**62))
        except client.SessionConnectingError:
            connecting.append(one)
    for state in states:
        del state["series"]
    if json:
        from imutui.logbook.results import dumps

        print(dumps(states + [{"name": one, "state": "connecting"} for one in connecting]))
    elif not names:
        print("no acquisition is running")
    for state in [] if json else states:
        print(_line(state))
    for one in [] if json else connecting:
        print(f"{one}: connecting to its instrument")


def _line(s: dict[str, Any]) -> str:
    rec = s["recording"]
    file = f"recording to {rec['path']} ({rec['seconds']:.0f} s, {rec['bytes']} bytes)" if rec else "not recording"
    measured = f"{s['measured_hz']:.2f}" if s["measured_hz"] else "–"
    return (
        f"{s['name']} (pid {s['pid']}): {s['instrument']} #{s['serial_number']} on {s['port']}, {s['state']},"
        f" {s['kind']}, asked {s['rate_hz']:g} Hz measured {measured}, lost {s['lost_packets']},"
        f" bad checksums {s['bad_checksums']}, {file}"
    )
