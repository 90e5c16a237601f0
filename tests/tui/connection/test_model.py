"""The acquisition that the UI looks at: series, feed, attempts."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest
from helpers.fake_client import FakeClient

from imutui.session.client import SessionError
from imutui.session.live_filter import RunHistory
from imutui.session.plan import HistoryWish
from imutui.tui.connecting import Attempt
from imutui.tui.connection.model import ConnectionModel
from imutui.tui.connection.packet_series import PacketSeries
from imutui.tui.connection.poller import Poller
from imutui.tui.terminal.pacing import Pacing


class Inbox:
    """Takes what a poller posts."""

    def __init__(self) -> None:
        self.messages: list[Poller.Arrived | Poller.Lost] = []
        self.came = threading.Event()

    def post(self, message: Poller.Arrived | Poller.Lost) -> bool:
        self.messages.append(message)
        self.came.set()
        return True

    def wait(self) -> None:
        assert self.came.wait(5.0)
        self.came.clear()


@contextmanager
def polled(client: FakeClient, rate_hz: float) -> Iterator[tuple[Inbox, Poller]]:
    inbox = Inbox()
    poller = Poller(client, inbox.post, rate_hz)  # type: ignore[arg-type]
    poller.start()
    try:
        yield inbox, poller
    finally:
        poller.stop()


def test_series_keep_their_capacity_in_order() -> None:
    series = PacketSeries(2, 100)
    numbers = np.arange(1234.0)
    for piece in np.array_split(numbers, 97):
        series.extend(piece, np.stack([piece, -piece], axis=1))
    t, values = series.last(np.inf)
    np.testing.assert_array_equal(t, numbers[-100:])
    np.testing.assert_array_equal(values[:, 1], -numbers[-100:])
    assert len(series) == 100


def test_a_frozen_series_stays() -> None:
    series = PacketSeries(1)
    series.extend(np.arange(5.0), np.ones((5, 1)))
    still = series.frozen()
    series.extend(np.arange(5.0, 10.0), np.ones((5, 1)))
    assert (len(still), len(series)) == (5, 10)


def test_a_new_run_starts_the_series_anew() -> None:
    series = PacketSeries(1)
    series.extend(np.arange(50.0), np.ones((50, 1)))
    series.extend(np.arange(3.0), np.ones((3, 1)))
    assert len(series) == 3


def test_slopes_are_per_minute() -> None:
    series = PacketSeries(1)
    t = np.arange(0.0, 60.0, 0.1)
    series.extend(t[:50], (0.01 * t[:50])[:, None])
    assert series.slope_per_minute(0) is None
    series.extend(t[50:], (0.01 * t[50:])[:, None])
    assert series.slope_per_minute(0) == pytest.approx(0.6, rel=1e-3)


def test_the_feed_waits_until_its_snapshot_is_taken() -> None:
    """With a frozen terminal, one snapshot is under way and no more."""
    client = FakeClient()
    with polled(client, 1000.0) as (inbox, poller):
        inbox.wait()
        assert not inbox.came.wait(0.1)
        assert client.polls == 1
        poller.taken()
        inbox.wait()


def test_the_feed_asks_only_for_what_is_new() -> None:
    with polled(FakeClient(), 20.0) as (inbox, poller):
        for _ in range(2):
            inbox.wait()
            poller.taken()
    first, second = (m.snapshot["series"] for m in inbox.messages[:2] if isinstance(m, Poller.Arrived))
    assert len(second["t"]) == second["next"] - first["next"] < 100


def test_who_attaches_late_sees_the_run_from_its_begin() -> None:
    """Biases, certainty, convergence and temperature since the first sample, in pieces, each sent once."""
    client, link = FakeClient(), ConnectionModel()
    client.changes["filter"] = None  # one that says no slope of its own
    client.past = RunHistory()
    for k in range(700):
        client.past.estimates.add(float(k), np.full(6, 0.5), np.full(6, 0.1), np.full(6, k >= 30))
        client.past.add_temperature(np.array([float(k)]), np.array([20.0 + 0.001 * k]))
    with polled(client, 100.0) as (inbox, _):
        inbox.wait()
    (first,) = inbox.messages
    assert isinstance(first, Poller.Arrived)
    assert [len(piece["estimates"]["t"]) for piece in first.history] == [100] * 7 + [7]
    link.take(first.snapshot, first.history)
    seen = link.view()
    assert len(seen.biases) == 700
    assert (seen.biases.converged(0).sum(), len(seen.temperature)) == (670, 700)
    assert seen.slope_k_per_min == pytest.approx(0.06, rel=0.05)
    other = RunHistory()
    other.estimates.add(0.5, np.zeros(6), np.ones(6))
    link.take(client.snapshot(), (other.piece(2, HistoryWish(1, 699.0, 699.0)),))
    assert len(link.view().biases) == 1


def test_a_lost_acquisition_is_told_once() -> None:
    client = FakeClient()
    client.gone = "the acquisition has ended"
    with polled(client, 10.0) as (inbox, _):
        inbox.wait()
    assert [m.error for m in inbox.messages if isinstance(m, Poller.Lost)] == ["the acquisition has ended"]


def test_the_pace_reaches_the_feed_and_the_view() -> None:
    link = ConnectionModel()
    link.set_pacing(Pacing("sweep", 4.0), "4 fps")
    client, inbox = FakeClient(), Inbox()
    link.attach(client, inbox.post)  # type: ignore[arg-type]
    assert link._poller is not None
    assert link._poller.rate_hz == 4.0
    link.set_pacing(Pacing("numbers", 2.0, note="link is slow"))
    assert link._poller.rate_hz == 2.0
    assert (link.view().pacing.mode, link.view().debug) == ("numbers", "")
    link.leave()


def test_freezing_keeps_the_view_and_not_the_data() -> None:
    client, link = FakeClient(), ConnectionModel()
    link.take(client.snapshot())
    link.freeze(True)
    before = len(link.view().series)
    client.recording = True
    link.take(client.snapshot(link.newest["series"]["next"] - 10 if link.newest else 0))
    frozen = link.view()
    assert frozen.frozen
    assert len(frozen.series) == before
    assert frozen.now is not None
    assert frozen.shown is not None
    assert (frozen.now["recording"] is None, frozen.shown["recording"] is None) == (False, True)
    link.freeze(False)
    assert not link.view().frozen


class Starter:
    """An acquisition whose start takes until it is let go."""

    def __init__(self) -> None:
        self.client = FakeClient()
        self.go = threading.Event()

    def start(self) -> Any:
        """Block, then succeed."""
        assert self.go.wait(5.0)
        return self.client


def test_what_was_given_up_is_stopped_when_it_begins() -> None:
    """Nobody would know of an acquisition whose start was cancelled."""
    starter = Starter()
    attempt = Attempt(starter.start)
    thread = threading.Thread(target=attempt.run)
    thread.start()
    attempt.give_up()
    starter.go.set()
    thread.join(5.0)
    assert starter.client.asked == ["stop"]
    assert attempt.take() is None
    assert attempt.wait(0.0)


def test_what_has_begun_and_was_not_taken_is_stopped_too() -> None:
    starter = Starter()
    starter.go.set()
    attempt = Attempt(starter.start)
    attempt.run()
    attempt.give_up()
    assert attempt.wait(5.0)
    assert starter.client.asked == ["stop"]


def test_letting_go_of_a_running_acquisition_does_not_stop_it() -> None:
    starter = Starter()
    starter.go.set()
    attempt = Attempt(starter.start, stops=False)
    attempt.run()
    attempt.give_up()
    assert attempt.wait(5.0)
    assert (starter.client.asked, starter.client.closed) == ([], True)


def test_a_failed_start_raises_only_if_somebody_waits() -> None:
    def fail() -> Any:
        raise SessionError("no answer")

    with pytest.raises(SessionError):
        Attempt(fail).run()
    attempt = Attempt(fail)
    attempt.give_up()
    attempt.run()
