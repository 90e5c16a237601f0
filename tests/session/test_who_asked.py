"""Each mark, stop and request of the guide is logged with program, user, terminal and process of who asked for it."""

import os
import pwd
import threading
from pathlib import Path

from helpers.commands import imutui_json
from helpers.documents import dwell, profile_toml
from helpers.processes import LIMIT_S, command_line, started, wait_until
from helpers.terminal import Terminal
from helpers.units import virtual

from imutui.logbook import reader
from imutui.session import client, ipc
from imutui.session.plan import Plan

USER = pwd.getpwuid(os.getuid()).pw_name
PROFILE = profile_toml(dwell(30.0), align="marks")


def test_who_marks_stops_and_presses_esc_is_in_the_log_and_in_the_events(home: Path) -> None:
    with virtual() as port:
        plan = Plan(
            port, rate_hz=20.0, logs=str(home / "logs"), filter="none", record=True,
            reference="profile", reference_file=("p.toml", PROFILE),
        )  # fmt: skip
        connection = client.start(plan)
        wait_until(lambda: (connection.snapshot(2**62)["recording"] or {}).get("samples", 0) > 5)
        with started(command_line("mark", "table level")) as process:
            assert process.wait(LIMIT_S) == 0
        terminal = Terminal(command_line("mark", "from a terminal"), (80, 24), home, controlling=True)
        name = os.ttyname(terminal._slave).removeprefix("/dev/")
        wait_until(lambda: "from a terminal" in str(connection.snapshot(2**62)["marks"]))
        terminal.close()
        connection.guide("begin")
        connection.guide("cancel")
        seen = [event["text"] for event in connection.snapshot(2**62)["events"]]
        stopped = imutui_json("stop", check=None)
    events = [event.text for event in reader.read(Path(stopped["log"])).events]
    ours = f"{USER}, pid {os.getpid()}" if not _terminal() else f"{USER} on {_terminal()}, pid {os.getpid()}"
    for wanted in (
        f'mark "table level" by imutui mark, {USER}, pid {process.pid}',
        f'mark "from a terminal" by imutui mark, {USER} on {name}, pid ',
        "guide: cancel, asked by ",
    ):
        assert any(text.startswith(wanted) for text in events), (wanted, events)
        assert any(text.startswith(wanted) for text in seen), wanted
    assert any(text.startswith("guide: cancel") and text.endswith(ours) for text in events)
    assert events[-1].startswith("ended by the command imutui stop")
    assert events[-1].endswith(ours)


def test_who_ends_a_recording_is_in_its_file(home: Path) -> None:
    with virtual() as port:
        connection = client.start(Plan(port, rate_hz=20.0, logs=str(home / "logs"), filter="none", record=True))
        wait_until(lambda: (connection.snapshot(2**62)["recording"] or {}).get("samples", 0) > 5)
        result = connection.stop_recording()
        connection.stop()
    assert any(event.text.startswith("recording ended by ") for event in reader.read(Path(result["log"])).events)


def test_a_viewer_cannot_pass_for_another_process(home: Path) -> None:
    asked = list[object]()
    server = ipc.Server("asked", lambda request: asked.append(request.get("peer")) or {})
    threading.Thread(target=server.serve_forever, args=(0.02,), daemon=True).start()
    with ipc.connect("asked", LIMIT_S) as connection:
        connection.sendall(b'{"ask": "stop", "peer": [0, 1]}\n')
        connection.recv(100)
    assert asked == [(os.getuid(), os.getpid())]
    server.shutdown()
    server.server_close()


def _terminal() -> str:
    return client._terminal()
