"""The socket of an acquisition, whoever connects to it, and where it is looked for from other environments."""

import fcntl
import json
import os
import socket
import threading
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from helpers.processes import wait_until

from filters.errors import InputError
from imutui.session import client, ipc, requests
from imutui.session.client import SessionError
from imutui.session.ipc import NameTakenError

HOSTILE = {
    "no number": b'{"ask": "snapshot", "since": 1e400}',
    "not a number": b'{"ask": "snapshot", "since": NaN}',
    "infinite": b'{"ask": "wait", "timeout_s": Infinity}',
    "brackets": b"[" * 900_000,
    "objects": b'{"ask":' * 100_000,
    "no text": b"\xff\xfe\x00\x01",
    "a list": b"[1, 2]",
    "a text": b'"snapshot"',
    "nothing": b"{}",
    "empty": b"",
    "unknown": b'{"ask": "format the disk"}',
    "of another kind": b'{"ask": ["snapshot"]}',
    "a failure": b'{"ask": "fail"}',
    "too long": b'{"ask": "' + b"x" * ipc.MAX_REQUEST + b'"}',
}


def answer(request: Mapping[str, object]) -> object:
    if request["ask"] == "mark":
        return "here"
    if str(request["ask"]) == "fail":
        raise RuntimeError("broken")
    raise InputError(f"no such request: {str(request['ask'])[:20]}")


@pytest.fixture
def server(home: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[ipc.Server]:
    """A socket that answers marks, and fails where it is asked to."""
    monkeypatch.setattr("tempfile.tempdir", str(home))
    made = ipc.Server("asked", answer)
    threading.Thread(target=made.serve_forever, args=(0.02,), daemon=True).start()
    yield made
    made.shutdown()
    made.server_close()


def ask(line: bytes) -> dict[str, Any]:
    with ipc.connect("asked", 60.0) as connection:
        return exchange(connection, line)


def exchange(connection: socket.socket, line: bytes) -> dict[str, Any]:
    with suppress(BrokenPipeError):  # a connection that is refused has its reply already
        connection.sendall(line + b"\n")
    with connection.makefile("rb") as replies:
        return dict(json.loads(replies.readline()))


@pytest.mark.parametrize("kind", HOSTILE)
def test_every_request_has_its_reply(server: ipc.Server, kind: str) -> None:
    reply = ask(HOSTILE[kind])
    assert reply["ok"] is False
    assert 0 < len(reply["error"]) < 1000
    assert ask(b'{"ask": "mark"}') == {"version": 1, "ok": True, "reply": "here"}
    wait_until(lambda: not server.viewers)
    assert reply["error"].startswith("a defect of imutui, ") == (kind == "a failure"), "nor is it the request's fault"
    assert ('with the field "ask"' in reply["error"]) == (kind in ("a list", "a text", "nothing"))


def test_a_viewer_that_was_refused_may_ask_again(server: ipc.Server) -> None:
    with ipc.connect("asked", 60.0) as connection:
        assert exchange(connection, b"[")["ok"] is False
        assert exchange(connection, b'{"ask": "mark"}')["ok"]
        assert exchange(connection, HOSTILE["too long"])["ok"] is False
        assert connection.recv(1) == b""


@contextmanager
def full(server: ipc.Server) -> Iterator[list[socket.socket]]:
    """While as many viewers as may be are connected and ask for nothing."""
    with ExitStack() as viewers:
        yield [viewers.enter_context(ipc.connect("asked", 60.0)) for _ in range(ipc.MAX_VIEWERS)]
    wait_until(lambda: not server.viewers)


def test_one_viewer_too_many_is_told_in_words_whatever_it_asks_and_before_a_screen_opens(server: ipc.Server) -> None:
    server.answer = lambda request: {"pid": 1}
    lock = ipc.lock("asked")
    with full(server) as viewers:
        assert "viewers are connected already" in ask(b"[]")["error"]
        assert exchange(viewers[0], b'{"ask": "snapshot"}')["ok"]
        with pytest.raises(SessionError, match="viewers are connected already"):
            client.attach("asked")
        for _ in range(5):  # it is refused while it still sends
            with pytest.raises(SessionError, match="viewers are connected already"):
                client._exchange(client._connect("asked"), "asked", 60.0, "guide", {"do": "x" * 200_000})
    assert client.attach("asked").pid == 1
    os.close(lock)


def test_a_burst_of_viewers_is_answered_whole(server: ipc.Server) -> None:
    """More than the kernel's queue holds, at the same moment: each waits for its turn."""

    def one(_: int) -> bool:
        with ipc.connect("asked", 60.0) as connection:
            return bool(exchange(connection, b'{"ask": "mark"}')["ok"])

    with ThreadPoolExecutor(40) as pool:
        assert all(pool.map(one, range(400)))


def test_another_user_is_not_heard(server: ipc.Server, monkeypatch: pytest.MonkeyPatch) -> None:
    with ipc.connect("asked", 60.0) as connection:
        assert exchange(connection, b'{"ask": "mark"}')["ok"]
    stranger: Callable[[socket.socket], tuple[int, int]] = lambda connection: (4242, 1)  # noqa: E731
    monkeypatch.setattr(ipc, "peer_of", stranger)
    with ipc.connect("asked", 60.0) as connection:
        assert "another user" in json.loads(connection.recv(1 << 12))["error"]


@pytest.mark.parametrize(
    ("request_", "words"),
    [
        ({"ask": "record", "wish": {"x": 1}}, "wish: `x` is unknown; known: note, operator"),
        ({"ask": "record", "wish": 5}, "`wish` is 5, not a table [wish]"),
        ({"ask": "guide", "wish": {}}, "`do` is missing"),
        ({"ask": "record", "wish": {"note": 5}}, "`note` is 5, not a text"),
        ({"ask": "configure", "changes": [1]}, "`changes` is [1], not a table [changes]"),
        ({"ask": "configure", "changes": {"reference_file": "ab"}}, "not a name and a text"),
        ({"ask": "configure", "changes": {"reference_file": ["n" * 999, "x"]}}, "longer than 200"),
        ({"ask": "configure", "changes": {"effects": 1}}, "changes: `effects` is 1, not a text"),
        ({"ask": "mark"}, "`text` is missing"),
        ({"ask": "zero", "argument": True}, "`argument` is True, not a whole number"),
        ({"ask": "snapshot", "since": 2**70}, "not a whole number"),
        ({"ask": "statistics"}, "`channel` is missing; it is a whole number"),
        ({"ask": "wait", "timeout_s": "x"}, "`timeout_s` is 'x', not a finite number from 0 to 86400"),
        ({"ask": "wait", "timeout_s": -1}, "`timeout_s` is -1, not"),
        ({"ask": "x" * 9999}, "not one of: snapshot, history"),
    ],
)
def test_a_field_that_does_not_fit_is_named(request_: dict[str, Any], words: str) -> None:
    reply = ipc.reply_to(json.dumps(request_).encode(), partial(requests.carry_out, None))  # type: ignore[arg-type]
    assert not reply["ok"]
    assert words in reply["error"]
    assert len(reply["error"]) < 500


@pytest.mark.parametrize("version", [0, 2, None])
def test_an_acquisition_of_another_version_is_refused_with_the_command_that_ends_it(
    server: ipc.Server, monkeypatch: pytest.MonkeyPatch, version: int | None
) -> None:
    monkeypatch.setattr(ipc, "VERSION", version)
    said = "it states no version" if version is None else f"its version is {version}, not 1"
    with pytest.raises(SessionError, match=said) as told:
        client.Client("asked")
    assert f"`kill {os.getpid()}` ends it and finishes its file" in str(told.value)


# Where acquisitions are looked for: shells of one user on one machine need not have the same environment


@pytest.mark.parametrize(("ours", "theirs"), [("", "run"), ("run", "run")])
def test_an_acquisition_in_the_cache_is_found_from_a_shell_with_a_runtime_folder(
    home: Path, monkeypatch: pytest.MonkeyPatch, ours: str, theirs: str
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(home / (ours or "none")))
    descriptor = ipc.lock("table")
    here = ipc.socket_path("table")
    assert here.parent == (home / ours / "imutui" if ours else home / "cache" / "imutui" / "run")
    try:
        monkeypatch.setenv("XDG_RUNTIME_DIR", str(home / theirs))
        assert ipc.names() == ["table"]
        assert ipc.socket_path("table") == here
        with pytest.raises(NameTakenError):
            ipc.lock("table")
    finally:
        os.close(descriptor)
    assert ipc.names() == []
    assert ipc.socket_path("table").parent == ipc.folder()


def test_who_only_looks_whether_a_name_is_taken_keeps_nobody_from_taking_it(home: Path) -> None:
    """`status` may look at the very moment at which an acquisition begins, and another `status` at the same time."""
    del home
    os.close(ipc.lock("table"))
    path = ipc.folder() / "table.lock"
    with path.open("rb") as looker:
        fcntl.flock(looker, fcntl.LOCK_SH)
        assert not ipc.is_locked(path)
        timer = threading.Timer(0.05, fcntl.flock, (looker, fcntl.LOCK_UN))
        timer.start()
        descriptor = ipc.lock("table")
        timer.join()
    assert ipc.is_locked(path)
    os.close(descriptor)
