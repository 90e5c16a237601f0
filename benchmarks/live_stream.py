"""Whether a live stream for Foxglove costs the acquisition anything: stamps and processor, with a viewer and without.

    python benchmarks/live_stream.py [--seconds 60]

Two virtual units in processes of their own send at 133 Hz over pseudo-terminals, and note when each packet's last byte
was written. Both are recorded and filtered at the same time; what one acquisition records is streamed, and a client in
a process of its own has subscribed to all of it. Lateness is the host's stamp less the time of writing. The processor's
time is that of the acquisition's process, and beside it that of the process that serves.
"""

import argparse
import contextlib
import json
import os
import socket
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

import numpy as np
from acquisition_cost import _taken_s
from machine import describe
from receive_jitter import _PERIOD_MS, unit_process

# what is shared with the tests: receive_jitter has put it on the path
from reliability.setting import NOTHING_NEW, log_packets, places

from filters.kalman import runner
from imutui.session import client as session
from imutui.session.client import Client
from imutui.session.plan import Plan

_WARM_UP_S = 15.0
_NAMES = ("without", "with")


def watch(port: str) -> None:
    """Subscribe to everything and take it, until the stream ends; prints how many messages."""
    from websockets.exceptions import ConnectionClosed
    from websockets.sync.client import connect
    from websockets.typing import Subprotocol

    got = 0
    address = f"ws://127.0.0.1:{port}"
    with (
        contextlib.suppress(ConnectionClosed),
        connect(address, subprotocols=[Subprotocol("foxglove.sdk.v1")]) as viewer,
    ):
        while True:
            message = viewer.recv()
            if isinstance(message, bytes):
                got += 1
            elif (told := json.loads(message))["op"] == "advertise":
                wishes = [{"id": channel["id"], "channelId": channel["id"]} for channel in told["channels"]]
                viewer.send(json.dumps({"op": "subscribe", "subscriptions": wishes}))
    print(got)


def acquire(port: str, folder: Path, name: str, foxglove_port: int) -> Client:
    """An acquisition with the filter at the full rate, as it is in the field."""
    own = f"bench-stream-{os.getpid()}-{name}"
    plan = Plan(port, 133.0, logs=str(folder / name), record=True, name=own, foxglove_port=foxglove_port)
    return session.start(plan)


def row(what: str, held: np.ndarray, sent: np.ndarray, share: float, since_ns: int) -> str:
    """A row of the table: of packets from an instant on at which both had long been running."""
    late = (held[:, 0] - sent[places(held, sent), 0])[held[:, 0] > since_ns] / 1e6
    lost = int(places(held, sent)[-1]) + 1 - len(held)
    median, p99, most = np.percentile(late, [50.0, 99.0, 100.0])
    over = 100.0 * float(np.mean(late > _PERIOD_MS))
    cells = f"{median:.2f} | {p99:.2f} | {most:.1f} | {over:.2f} | {lost} of {len(held)} | {100.0 * share:.1f}"
    return f"| {what} | {cells} |"


def main() -> None:
    """Measure both at once."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--role", nargs="+", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.role:
        watch(options.role[1])
        return
    print(describe("foxglove-sdk", "numpy", "pyserial"), flush=True)
    runner.warm_up()  # else there is a compiler in it
    with tempfile.TemporaryDirectory() as made, ExitStack() as ends:
        folder = Path(made)
        with socket.create_server(("127.0.0.1", 0)) as free:
            port = free.getsockname()[1]
        with ExitStack() as units:
            ports = [units.enter_context(unit_process(folder / f"{name}.npy")) for name in _NAMES]
            clients = [
                acquire(unit, folder, name, number) for unit, name, number in zip(ports, _NAMES, (0, port), strict=True)
            ]
            viewer = subprocess.Popen([sys.executable, __file__, "--role", "watch", str(port)], stdout=subprocess.PIPE)
            ends.callback(viewer.kill)
            time.sleep(_WARM_UP_S)
            before, since = [_taken_s(client.pid) for client in clients], time.monotonic()
            server = _children(clients[1].pid)[0]
            served_before = _taken_s(server)
            time.sleep(options.seconds)
            taken_s = time.monotonic() - since
            shares = [(_taken_s(c.pid) - b) / taken_s for c, b in zip(clients, before, strict=True)]
            served = (_taken_s(server) - served_before) / taken_s
            told = clients[1].snapshot(NOTHING_NEW)
            logs = [Path(client.snapshot(NOTHING_NEW)["recording"]["path"]) for client in clients]  # type: ignore[index]
            for client in clients:
                client.stop()
            received, _ = viewer.communicate(timeout=30.0)
        print(
            "\n| acquisition | median, ms | p99, ms | max, ms | later than a period, % | lost | % of a processor |"
            "\n|---|---|---|---|---|---|---|"
        )
        for what, name, log, share in zip(("no stream", "stream, one viewer"), _NAMES, logs, shares, strict=True):
            print(row(what, log_packets(log), np.load(folder / f"{name}.npy"), share, int(since * 1e9)))
        print(f"\nthe process that serves: {100.0 * served:.1f} % of a processor; stream: {told.get('stream')}")
        print(f"the viewer received {int(received)} messages")


def _children(pid: int) -> list[int]:
    return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


if __name__ == "__main__":
    main()
