"""What the live screen costs on a real link: bytes a second that ssh -C moves for it over the loopback interface.

    python benchmarks/ssh_link.py [--seconds 10] [--size 120x40] [--fps 10] [--plots scroll sweep numbers]

`imutui attach` on a recording of the virtual instrument, run by a real sshd under a real ssh -C -tt, in a terminal
of that size which answers that it has synchronised updates. Counted are the bytes that come back to the client on its
TCP connection, by a relay between both: compression, encryption and SSH's own packets included. The first seconds, in
which the whole screen is painted, are counted apart.
"""

import argparse
import os
import shlex
import sys
import tempfile
import time
from pathlib import Path
from types import TracebackType
from typing import Self

from bench import describe
from terminals import ENVIRONMENT

from filters.kalman import runner
from imutui.session import client as session
from imutui.session.plan import Plan

# the sshd of its own and the relay that counts are the tests'
sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "support"))

from helpers.loopback import CountingProxy, SshServer, Terminal, missing

_WARM_UP_S = 3.0
_NAME = f"bench-ssh-{os.getpid()}"


class Link:
    """An sshd with keys, configuration and port of its own for this user and this run, and a relay that counts."""

    def __init__(self) -> None:
        self._temporary = tempfile.TemporaryDirectory()
        self.folder = Path(self._temporary.name)

    def __enter__(self) -> Self:
        self._server = SshServer(self.folder)
        self._relay = CountingProxy(self._server.port)
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._relay.close()
        self._server.close()
        self._temporary.cleanup()

    def command(self, program: list[str], **environ: str) -> list[str]:
        """Command line that runs a program at the other end of ssh -C, in the terminal that it is itself run in."""
        variables = [f"{name}={value}" for name, value in (ENVIRONMENT | environ).items()]
        client = self._server.client(self._relay.port, ("-C",))
        return [*client, shlex.join(["env", *variables, *program])]

    def terminal(self, program: list[str], size: tuple[int, int], environ: dict[str, str]) -> Terminal:
        """A program at the other end of ssh -C, in a terminal of ours."""
        return Terminal(
            self._server.client(self._relay.port, ("-C",)), program, self.folder, ENVIRONMENT | environ, size
        )

    def bytes_between(self, begin: float, end: float) -> int:
        """Bytes that came back between two times of the wall's clock."""
        return self._relay.returned(begin, end)


def through_ssh(
    program: list[str], size: tuple[int, int], seconds: float, sign: str, **environ: str
) -> tuple[float, float]:
    """Run a program under ssh -C for some seconds.

    `program`: what runs at the other end; it is ended.
    `size`: columns and rows of the terminal.
    `seconds`: how long is counted, after the warm-up.
    `sign`: a text on its screen once it runs.
    `**environ`: variables that the program gets.
    Returns kilobytes a second once it runs, and kilobytes of the time before.
    """
    with Link() as link:
        begun = time.time()
        terminal = link.terminal(program, size, environ)
        try:
            terminal.wait_for(sign)
            time.sleep(_WARM_UP_S)
            warm = time.time()
            time.sleep(seconds)
            end = time.time()
        finally:
            terminal.close()
        return link.bytes_between(warm, end) / (end - warm) / 1e3, link.bytes_between(begun, warm) / 1e3


def main() -> None:
    """Measure each kind of plot."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--size", default="120x40")
    parser.add_argument("--fps", type=float, default=10.0)
    parser.add_argument("--plots", nargs="+", default=["scroll", "sweep", "numbers"])
    options = parser.parse_args()
    if lacking := missing():
        sys.exit(lacking)
    columns, rows = options.size.split("x")
    print(describe("textual", "numpy"), flush=True)
    runner.warm_up()  # else the first link waits for a compiler
    with tempfile.TemporaryDirectory() as logs:
        client = session.start(Plan("virtual", 133.0, logs=logs, name=_NAME, record=True, virtual=("--seed", "1")))
        try:
            attach = [sys.executable, "-m", "imutui", "attach", "--name", _NAME]
            for plot in options.plots:
                wish = {"IMUTUI_SCREEN_PLOT": plot, "IMUTUI_SCREEN_FPS": f"{options.fps:g}"}
                rate, first = through_ssh(attach, (int(columns), int(rows)), options.seconds, "deg/s", **wish)
                print(
                    f"{options.size} {plot:<7} {options.fps:g} fps asked: {rate:6.2f} kB/s through ssh -C"
                    f"  (until then {first:.1f} kB)",
                    flush=True,
                )
        finally:
            client.stop()


if __name__ == "__main__":
    main()
