"""Requests while the worker is busy: every viewer gets an answer, and nothing is carried out behind its back."""

import json
import os
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from helpers.acquisitions import Running, acquiring
from helpers.processes import LIMIT_S, wait_until

from imutui.logbook import reader
from imutui.session import client, ipc, requests
from imutui.session.client import SessionError


@contextmanager
def busy(run: Running) -> Iterator[None]:
    """While the worker does something that takes long, as waiting for a filter that is compiled."""
    begun, go_on = threading.Event(), threading.Event()

    def hold(_: object) -> None:
        begun.set()
        assert go_on.wait(LIMIT_S)

    with ThreadPoolExecutor(1) as pool:
        held = pool.submit(run.engine.call, hold, LIMIT_S)
        assert begun.wait(LIMIT_S)
        try:
            yield
        finally:
            go_on.set()
            held.result()


def ask(run: Running, **request: Any) -> dict[str, Any]:
    """Reply of the process to a request of somebody who waits for a tenth of a second."""
    line = json.dumps({"patience_s": 0.1, **request}).encode()
    return dict(ipc.reply_to(line, partial(requests.carry_out, run.engine)))


CHANGES: dict[str, dict[str, Any]] = {
    "begin_statistics": {},
    "mark": {"text": "behind the back"},
    "record": {"wish": {}},
    "describe": {"note": "behind the back"},
    "configure": {"changes": {"reference": "gravity"}},
    "zero": {"argument": 30},
    "guide": {"do": "cancel", "wish": {}},
    "stop_recording": {},
}


def test_what_was_refused_because_the_worker_is_busy_is_not_done_later(home: Path) -> None:
    with acquiring(home) as run:
        with busy(run):
            replies = {name: ask(run, ask=name, **fields) for name, fields in CHANGES.items()}
        run.more_packets()
        assert run.seen()["recording"] is not None
        events, log = run.content()
    assert all(not reply["ok"] and "did nothing of this" in reply["error"] for reply in replies.values()), replies
    assert not [text for text in events if "behind the back" in text or "asked by" in text or "zeroing" in text]
    assert log.info.note == ""


def test_what_is_being_done_when_patience_ends_is_said_to_be_finished_later(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from imutui.session.recording import Recording

    begun, go_on, end = threading.Event(), threading.Event(), Recording.end

    def slowly(recording: Recording) -> Any:
        begun.set()
        assert go_on.wait(LIMIT_S)
        return end(recording)

    with acquiring(home) as run:
        monkeypatch.setattr(Recording, "end", slowly)
        with ThreadPoolExecutor(1) as pool:
            asked = pool.submit(ask, run, ask="stop_recording", patience_s=1.0)
            assert begun.wait(LIMIT_S)
            reply = asked.result(LIMIT_S)
            go_on.set()
        assert "will finish it" in reply["error"]
        wait_until(lambda: run.seen()["recording"] is None)
    assert reader.read(run.first).finished


def test_no_error_of_the_system_reaches_a_viewer_without_words() -> None:
    def fail(_: object) -> Any:
        raise TimeoutError

    assert ipc.reply_to(b'{"ask": "snapshot"}', fail)["error"] == "it failed: TimeoutError"


def test_a_client_whose_patience_ends_hears_so_in_words(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The acquisition says no before the viewer gives up, and one that hangs is named."""
    monkeypatch.setattr(client, "_REPLY_S", 1.0)
    monkeypatch.setattr(client, "_STOP_S", 1.0)
    hangs = threading.Event()
    with acquiring(home) as run:
        lock = ipc.lock("default")
        server = ipc.Server("default", partial(requests.carry_out, run.engine))
        threading.Thread(target=server.serve_forever, args=(0.02,), daemon=True).start()
        viewer = client.Client("default")
        with busy(run), pytest.raises(SessionError, match="did nothing of this"):
            viewer.mark("behind the back")
        server.answer = lambda request: hangs.wait(LIMIT_S)
        with pytest.raises(SessionError, match="has not answered for 1 s"):
            viewer.stop()
        hangs.set()
        server.shutdown()
        server.server_close()
        os.close(lock)
