"""An OpenSSH server on loopback with keys and a port of its own, and terminals on the far end of it.

A log-in over SSH has here what it has in the field, and lacks what it lacks there: a pseudo-terminal that goes when the
link goes, and no XDG_RUNTIME_DIR unless somebody sets one.
"""

import fcntl
import getpass
import grp
import os
import pty
import shlex
import shutil
import signal
import socket
import struct
import subprocess
import termios
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pyte

from helpers.processes import LIMIT_S, family, free_port

SSHD = shutil.which("sshd", path=f"{os.environ.get('PATH', '')}:/usr/sbin:/sbin")
PATIENCE_S = 60.0
_ASKS_FOR_SYNCHRONISED, _IT_IS_SYNCHRONISED = b"\x1b[?2026$p", b"\x1b[?2026;2$y"
_CONFIG = """\
Port {port}
ListenAddress 127.0.0.1
HostKey {folder}/host_key
AuthorizedKeysFile {folder}/user_key.pub
PidFile {folder}/sshd.pid
StrictModes no
UsePAM no
PasswordAuthentication no
PermitRootLogin yes
PrintMotd no
"""


def missing() -> str | None:
    """What this machine lacks for a server and a client, if anything."""
    absent = [name for name, found in (("sshd", SSHD), ("ssh", shutil.which("ssh"))) if not found]
    if absent:
        return f"needs {' and '.join(absent)}"
    return None if _may_hand_over_terminals() else "this user's sshd may not give terminals to the group tty"


def _may_hand_over_terminals() -> bool:
    """Whether sshd can give a log-in a terminal: its group is tty's already, or this user may change it."""
    master, slave = pty.openpty()
    try:
        wanted = grp.getgrnam("tty").gr_gid
        return os.getuid() == 0 or os.fstat(slave).st_gid == wanted or wanted in os.getgroups()
    except KeyError:
        return True  # there is no such group: it stays as it is
    finally:
        os.close(master)
        os.close(slave)


class SshServer:
    """An sshd of this user; `close` ends it and every session on it.

    `folder`: gets keys, configuration and log.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        for key in ("host_key", "user_key"):
            command = ["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(folder / key)]
            subprocess.run(command, check=True, timeout=LIMIT_S)
        if os.getuid() == 0:
            # where root's sshd locks its unprivileged half in; the init script makes it, and no init runs here
            Path("/run/sshd").mkdir(mode=0o755, exist_ok=True)
        # another process may take the port between its being found free and sshd's taking it
        for _ in range(5):
            self.port = free_port()
            self._process = self._serve()
            if self._answers():
                return
        raise RuntimeError(f"sshd did not begin: {(folder / 'sshd.log').read_text()}")

    def _serve(self) -> "subprocess.Popen[bytes]":
        config = self.folder / "sshd_config"
        config.write_text(_CONFIG.format(port=self.port, folder=self.folder))
        with (self.folder / "sshd.log").open("ab") as log:
            return subprocess.Popen([str(SSHD), "-D", "-e", "-f", str(config)], stdin=subprocess.DEVNULL, stderr=log)

    def _answers(self) -> bool:
        deadline = time.monotonic() + PATIENCE_S
        while self._process.poll() is None and time.monotonic() < deadline:
            try:
                with socket.create_connection(("127.0.0.1", self.port)) as there:
                    return there.recv(4) == b"SSH-"
            except OSError:
                time.sleep(0.02)
        return False

    def client(self, port: int | None = None, options: tuple[str, ...] = ()) -> list[str]:
        """Command line of an ssh client with a terminal, up to the command to run there."""
        return [
            *("ssh", "-tt", "-q", "-F", "none", "-p", str(port or self.port), "-i", str(self.folder / "user_key")),
            *("-o", "IdentitiesOnly=yes", "-o", "BatchMode=yes", "-o", "StrictHostKeyChecking=no"),
            *("-o", "UserKnownHostsFile=/dev/null", "-e", "none", *options, f"{getpass.getuser()}@127.0.0.1"),
        ]

    def sessions(self) -> list[int]:
        """Processes of sshd that serve sessions, those of all that are open."""
        return [pid for pid in family(self._process.pid)[1:] if _name(pid).startswith("sshd")]

    def close(self) -> None:
        for pid in [*self.sessions(), self._process.pid]:
            _signal(pid, signal.SIGKILL)
        self._process.wait(LIMIT_S)


class Terminal:
    """A program on the far end of an ssh client of ours, and the screen that it shows here.

    `command`: the ssh client's, up to what is to be run.
    `program`: what is to be run.
    `folder`: where it is run.
    `environ`: its variables beyond what a log-in has; an ssh client hands over none but TERM.
    `size`: columns and rows.
    """

    def __init__(
        self,
        command: list[str],
        program: list[str],
        folder: Path,
        environ: dict[str, str],
        size: tuple[int, int] = (80, 24),
    ) -> None:
        self._screen = pyte.Screen(*size)
        self._stream = pyte.ByteStream(self._screen)
        self._changed = threading.Condition()
        self._master, slave = pty.openpty()
        fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", size[1], size[0], 0, 0))
        variables = [f"{name}={value}" for name, value in environ.items()]
        there = f"cd {shlex.quote(str(folder))} && exec {shlex.join(['env', *variables, *program])}"
        self.process = subprocess.Popen(
            [*command, there], stdin=slave, stdout=slave, stderr=slave, start_new_session=True,
            env={"PATH": os.environ["PATH"], "HOME": str(folder), "TERM": "xterm-256color"},
        )  # fmt: skip
        os.close(slave)
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        while True:
            try:
                data = os.read(self._master, 65536)
            except OSError:
                os.close(self._master)
                return  # the client has gone
            if _ASKS_FOR_SYNCHRONISED in data:
                os.write(self._master, _IT_IS_SYNCHRONISED)
            with self._changed:
                self._stream.feed(data)
                self._changed.notify_all()

    def screen(self) -> str:
        """What is shown."""
        with self._changed:
            return "\n".join(self._screen.display)

    def wait_for(self, *texts: str) -> str:
        """Wait until all these texts are shown at once; returns the screen."""
        deadline = time.monotonic() + PATIENCE_S
        with self._changed:
            while not all(text in (shown := self.screen()) for text in texts):
                if time.monotonic() > deadline:
                    raise AssertionError(f"the screen never showed {texts}:\n{shown}")
                self._changed.wait(1.0)
        return shown

    def press(self, keys: str) -> None:
        os.write(self._master, keys.encode())

    def send(self, number: signal.Signals) -> None:
        """Send a signal to the ssh client, not to what runs there."""
        self.process.send_signal(number)

    def close(self) -> None:
        self.process.kill()
        self.process.wait(LIMIT_S)
        self._reader.join(LIMIT_S)


class CountingProxy:
    """Passes connections on to a port of this machine and counts the bytes that come back from there."""

    def __init__(self, port: int) -> None:
        self._target = port
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = int(self._listener.getsockname()[1])
        self._returned: list[tuple[float, int]] = []
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self) -> None:
        while True:
            try:
                here, _ = self._listener.accept()
            except OSError:
                return  # closed
            there = socket.create_connection(("127.0.0.1", self._target))
            threading.Thread(target=_pass_on, args=(here, there, lambda count: None), daemon=True).start()
            threading.Thread(target=_pass_on, args=(there, here, self._count), daemon=True).start()

    def _count(self, count: int) -> None:
        self._returned.append((time.time(), count))

    def returned(self, begin: float, end: float) -> int:
        """Bytes from the target to its clients between two times of the wall's clock."""
        return sum(count for at, count in list(self._returned) if begin <= at < end)

    def close(self) -> None:
        # without it a thread in accept() keeps the port open
        self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()


def _pass_on(source: socket.socket, sink: socket.socket, count: Callable[[int], None]) -> None:
    try:
        while data := source.recv(65536):
            count(len(data))
            sink.sendall(data)
        sink.shutdown(socket.SHUT_WR)
    except OSError:
        source.close()
        sink.close()


def processes_with(variable: str) -> set[int]:
    """Living processes that have this NAME=value in their environment."""
    found = set()
    for process in Path("/proc").glob("[0-9]*"):
        try:
            if variable.encode() in (process / "environ").read_bytes().split(b"\0"):
                found.add(int(process.name))
        except OSError:
            continue  # it has ended meanwhile, or is another user's
    return found


def _name(pid: int) -> str:
    try:
        return Path(f"/proc/{pid}/comm").read_text().strip()
    except OSError:
        return ""


def _signal(pid: int, number: signal.Signals) -> None:
    try:
        os.kill(pid, number)
    except ProcessLookupError:
        return
