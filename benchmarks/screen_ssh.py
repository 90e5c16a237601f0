"""An SSH server of our own on the loopback interface, with a relay in front that counts what goes through."""

import getpass
import select
import socket
import subprocess
import threading
import time
from pathlib import Path


class Server:
    """A daemon with keys made for this run only, and a relay.

    Parameters
    ----------
    folder : Path
        For keys; goes with the run.
    sshd : str
        Path of the daemon.
    """

    def __init__(self, folder: Path, sshd: str) -> None:
        self._folder, self._sshd = folder, sshd
        self._moved: list[tuple[float, int]] = []
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = int(self._listener.getsockname()[1])

    def __enter__(self) -> "Server":
        for name in ("host", "user"):
            subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(self._folder / name)], check=True)
        (self._folder / "authorized").write_bytes((self._folder / "user.pub").read_bytes())
        with socket.create_server(("127.0.0.1", 0)) as probe:
            self._behind = int(probe.getsockname()[1])
        settings = {
            "HostKey": self._folder / "host", "AuthorizedKeysFile": self._folder / "authorized", "StrictModes": "no",
            "ListenAddress": "127.0.0.1", "Port": self._behind, "PidFile": "none", "UsePAM": "no",
            "PermitRootLogin": "yes",
        }  # fmt: skip
        options = [part for key, value in settings.items() for part in ("-o", f"{key}={value}")]
        if Path("/run").is_dir():
            Path("/run/sshd").mkdir(exist_ok=True)  # where the daemon locks its unprivileged half in
        self._daemon = subprocess.Popen([self._sshd, "-D", "-f", "/dev/null", *options], stderr=subprocess.DEVNULL)
        threading.Thread(target=self._relay, daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self._listener.close()
        self._daemon.terminate()
        self._daemon.wait()

    def command(self, remote: str) -> list[str]:
        """Command line of a client with compression."""
        quiet = {"StrictHostKeyChecking": "no", "UserKnownHostsFile": "/dev/null", "LogLevel": "ERROR"}
        options = [part for key, value in quiet.items() for part in ("-o", f"{key}={value}")]
        key = str(self._folder / "user")
        target = f"{getpass.getuser()}@127.0.0.1"
        return ["ssh", "-tt", "-C", "-F", "/dev/null", "-i", key, *options, "-p", str(self.port), target, remote]

    def bytes_between(self, start: float, end: float) -> int:
        """Bytes from the server to the client in a stretch of time."""
        return sum(count for at, count in self._moved if start <= at <= end)

    def _relay(self) -> None:
        try:
            client, _ = self._listener.accept()
        except OSError:
            return
        server = self._connect()
        with client, server:
            while True:
                for source in select.select([client, server], [], [])[0]:
                    data = source.recv(1 << 16)
                    if not data:
                        return
                    if source is server:
                        self._moved.append((time.time(), len(data)))
                    (client if source is server else server).sendall(data)

    def _connect(self) -> socket.socket:
        """Connection to the daemon, as soon as it listens."""
        deadline = time.monotonic() + 20.0
        while True:
            try:
                return socket.create_connection(("127.0.0.1", self._behind))
            except OSError:
                if time.monotonic() > deadline:
                    raise
                select.select([], [], [], 0.05)
