"""A public driver of Acutrol controllers, on the virtual one: whether it starts, turns, positions and shuts down.

    python benchmarks/acutrol_driver.py --acutrol DIR

Nothing is downloaded. DIR has acutrol.py and ac117.json of https://github.com/AcutronicRobotics/acutrol (MIT, at
5e9b652e). The driver is of Python 2, and is made to run when it is loaded, without a change to its files: lib2to3 of
the standard library (Python 3.12 at the latest) turns its syntax, and its sockets take and give text in place of bytes,
as those of Python 2 did. It does not look at what its commands are answered at start and end; this script does.
"""

import math
import socket
import sys
import time
import warnings
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any, ClassVar

import bench
from helpers.tables import served

from filters.simulation import TableModel

RATE, POSITION = 0.5, 1.0  # rad/s, rad


class TextSocket(socket.socket):
    """A socket of Python 2, which keeps what was said."""

    said: ClassVar[list[tuple[str, str]]] = []

    def send(self, data: Any, *flags: int) -> int:
        self.said.append((data, ""))
        return super().send(data.encode("latin-1"), *flags)

    def recv(self, *arguments: int) -> Any:
        text = super().recv(*arguments).decode("latin-1")
        self.said[-1] = self.said[-1][0], text
        return text


def loaded(folder: Path) -> ModuleType:
    """The driver's module."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from lib2to3.refactor import RefactoringTool, get_fixers_from_package
    path = folder / "acutrol.py"
    if not path.exists() or not (folder / "ac117.json").exists():
        raise SystemExit(f"{folder} has no acutrol.py and ac117.json: see the top of this script")
    tool = RefactoringTool(get_fixers_from_package("lib2to3.fixes"))
    module = ModuleType("acutrol")
    exec(compile(str(tool.refactor_string(path.read_text(), str(path))), str(path), "exec"), vars(module))
    vars(module)["socket"] = SimpleNamespace(socket=TextSocket, AF_INET=socket.AF_INET, SOCK_STREAM=socket.SOCK_STREAM)
    return module


def main() -> int:
    asked = bench.options(__doc__, acutrol=Path)
    print(bench.describe("numpy"))
    module = loaded(asked.acutrol)
    with served(TableModel(axes=("inner",), seed=1)) as it:
        device = module.AcutrolDevice("127.0.0.1", it.server.port)
        print("at the beginning", device.status())
        device.command_rate(RATE)
        time.sleep(2.0)
        turning = device.status()
        print("at a rate of", RATE, turning)
        device.command_position(POSITION)
        time.sleep(6.0)
        there = device.status()
        print("at a position of", POSITION, there)
        ended = device.shutdown()
        off = it.table.axes["inner"].mode
        device.sock.close()
    for sent, heard in TextSocket.said:
        print(f"  {sent.strip():32} {heard!r}")
    refused = [sent for sent, heard in TextSocket.said if ":read" not in sent and heard[8:] != "OK"]
    off_by = abs(turning["velocity"] - RATE), abs(math.remainder(there["position"] - POSITION, 2.0 * math.pi))
    print(f"rate off by {off_by[0]:.1e} rad/s, position by {off_by[1]:.1e} rad; refused: {refused or 'nothing'};")
    print(f"at the end it takes its commands for {'done' if ended else 'failed'}, and the axis is {off}")
    return 0 if not refused and ended and off == "off" and max(off_by) < 1e-3 else 1


if __name__ == "__main__":
    sys.exit(main())
