"""What is recorded, handed to a process of its own (`foxglove_server`) that serves it to Foxglove.

A process of its own, and not a thread: the library that serves is native code with threads of its own. Whatever becomes
of it, or of a viewer, happens elsewhere: a crash ends that process only, its memory is its own, and it takes no turn of
this interpreter, which stamps packets. All that is done here is to hand a message on after the file has it, without
waiting: what the socket does not take waits in a queue of bounded length; when that is full the oldest is left out, and
counted. The stream is what files get: while nothing is recorded there is none.
"""

import contextlib
import json
import socket
import struct
import subprocess
import sys
from collections import deque

from imutui.logbook import schemas
from imutui.plain_text import NOTE_LIMIT, one_line
from imutui.session.snapshot import StreamSnapshot

WAITING_LIMIT = 4096  # messages that wait for the serving process: ten seconds at the full rate, and about 2 MB
# what precedes the bytes of each message: number of its topic, in the order of `schemas.TYPES`, and log time, ns
MESSAGE = struct.Struct("<BQ")
TOPICS = tuple(schemas.TYPES)
MESSAGE_LIMIT = 1 << 17  # bytes of one message at most, with what precedes it
_START_S = 30.0
_LAST_S = 0.5
_END_S = 3.0
_BUFFER_BYTES = 1 << 20
_NUMBERS = {topic: number for number, topic in enumerate(TOPICS)}


class StreamError(Exception):
    """The stream cannot be served; the message says why and what to do."""


class LiveStream:
    """The stream of one acquisition. Not thread-safe: the worker, which writes the file, hands messages on.

    Viewers show its name. `origins`: further origins of pages that may read it, see `origin_gate`; blanks between.
    Raises StreamError if the library is not installed, the port is taken, or the address is none of this computer.
    """

    def __init__(self, host: str, port: int, name: str, origins: str = "") -> None:
        self.url = f"ws://{f'[{host}]' if ':' in host else host}:{port}"
        self._waiting: deque[bytes] = deque()
        self._sent = self._dropped = self._viewers = self._slow = 0
        self._ended = self._is_told = False
        self._socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _BUFFER_BYTES)
        arguments = [host, str(port), name, origins, str(theirs.fileno())]
        # the environment and stderr are the acquisition's; what the library says goes into its log
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "imutui.session.foxglove_server", *arguments],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            pass_fds=[theirs.fileno()],
        )
        theirs.close()
        try:
            self._await_start()
        except BaseException:
            self.close()
            raise

    @property
    def pid(self) -> int:
        """Of the process that serves."""
        return self._process.pid

    def _await_start(self) -> None:
        self._socket.settimeout(_START_S)
        try:
            told = self._socket.recv(MESSAGE_LIMIT)
        except OSError:
            told = b""
        if told:
            error = json.loads(told).get("error")
        else:
            error = "what serves the stream for Foxglove did not begin. Try again, or record without --foxglove."
        if error is not None:
            raise StreamError(error)
        self._socket.setblocking(False)

    def send(self, topic: str, data: bytes, log_ns: int) -> None:
        """Hand a message (CDR) on, or keep it for a moment; never waits and never raises."""
        if self._ended:
            return
        if len(self._waiting) >= WAITING_LIMIT:
            self._waiting.popleft()
            self._dropped += 1
        self._waiting.append(MESSAGE.pack(_NUMBERS[topic], log_ns) + data)
        self._hand_on()

    def _hand_on(self) -> None:
        try:
            while self._waiting:
                self._socket.send(self._waiting[0])
                self._waiting.popleft()
                self._sent += 1
        except BlockingIOError:
            pass  # it is busy: what waits goes with the next message
        except TimeoutError:
            pass  # at the end, when it is waited for
        except OSError:
            self._give_up()

    def _give_up(self) -> None:
        self._ended = True
        self._dropped += len(self._waiting)
        self._waiting.clear()

    def look(self) -> str | None:
        """Hear how it goes; once a second. Returns words for a stream that has ended by itself, once."""
        self._hand_on()
        while not self._ended:
            try:
                told = self._socket.recv(MESSAGE_LIMIT)
            except BlockingIOError:
                break
            except OSError:
                told = b""
            if not told:
                self._give_up()
                break
            with contextlib.suppress(ValueError, KeyError):
                said = json.loads(told)
                self._viewers, self._slow = int(said["viewers"]), int(said["slow"])
        if not self._ended or self._is_told:
            return None
        self._is_told = True
        return "the stream for Foxglove has ended by itself, the recording goes on; the acquisition's log may say why"

    def snapshot(self) -> StreamSnapshot:
        """How it goes, for viewers of the acquisition."""
        return {
            "url": self.url,
            "viewers": 0 if self._ended else self._viewers,
            "slow": self._slow,
            "sent": self._sent,
            "dropped": self._dropped,
            "ended": self._ended,
        }

    def close(self) -> None:
        """End the stream after what waits, and see its process gone, so that its port is free again."""
        if not self._ended:
            with contextlib.suppress(OSError):  # among them: it takes too long
                self._socket.settimeout(_LAST_S)
                self._hand_on()
        self._give_up()
        self._socket.close()
        try:
            self._process.wait(_END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def title(name: str) -> str:
    """What viewers show of an acquisition."""
    return one_line("imutui" if name == "default" else f"imutui {name}", NOTE_LIMIT)
