"""Starting an acquisition, which takes a while and may be given up meanwhile."""

import contextlib
import threading
from collections.abc import Callable

from imutui.session.client import Client, SessionError


class Attempt:
    """One start in a thread of its own.

    An acquisition that begins after it was given up is stopped again: nobody would know of it.

    `start`: blocks until the acquisition streams, or raises SessionError.
    `stops`: whether giving up stops it; False for one that ran before, which is only let go.
    """

    def __init__(self, start: Callable[[], Client], *, stops: bool = True) -> None:
        self._start = start
        self._stops = stops
        self._lock = threading.Lock()
        self._given_up = False
        self._client: Client | None = None
        self._done = threading.Event()

    def run(self) -> None:
        """Start; to be called in a thread."""
        try:
            client = self._start()
            with self._lock:
                self._client = None if self._given_up else client
            if self._client is None:
                self._end(client)
        except SessionError:
            if not self._given_up:
                raise
        finally:
            self._done.set()

    def take(self) -> Client | None:
        """The client, which from then on is the caller's."""
        with self._lock:
            client, self._client = self._client, None
        return client

    def give_up(self) -> None:
        """Have what is being started stopped: later, if it has not begun."""
        with self._lock:
            self._given_up = True
            client, self._client = self._client, None
        if client is not None:
            self._done.clear()
            threading.Thread(target=self._stop, args=(client,), name="imutui-give-up", daemon=True).start()

    def _stop(self, client: Client) -> None:
        with contextlib.suppress(SessionError):  # it may have ended by itself, which is what was wanted
            self._end(client)
        self._done.set()

    def _end(self, client: Client) -> None:
        if self._stops:
            client.stop("the screen, whose start was cancelled")
        else:
            client.close()

    def wait(self, timeout: float) -> bool:
        """Wait until nothing is under way any more; False if it takes longer."""
        return self._done.wait(timeout)
