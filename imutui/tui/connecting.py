"""Connecting: starting an acquisition or taking up one that runs, what then comes from it, its end, and leaving it."""

import contextlib
import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from textual.message import Message
from textual.screen import ModalScreen
from textual.widgets import Input

from filters.errors import InputError
from imutui.session import batch as session_batch
from imutui.session import client as session
from imutui.session.client import Client, EndReport, SessionError
from imutui.session.plan import MAX_RATE_HZ, VIRTUAL_PORT, Plan, demo
from imutui.session.snapshot import RecordingSnapshot
from imutui.tui import formatting, messages
from imutui.tui.background import in_thread
from imutui.tui.connection.poller import Poller
from imutui.tui.connection.rack import Rack
from imutui.tui.context import FAULTS, AppContext
from imutui.tui.pages import requests
from imutui.tui.pages.dialogs.choice import ended_dialog, jobs_dialog, quit_dialog, quit_rack_dialog, stop_dialog
from imutui.tui.pages.record import text
from imutui.tui.recording import RecordingControl

if TYPE_CHECKING:
    from imutui.jobs.documents import RunDocument

TellFinished = Callable[[RecordingSnapshot, "RunDocument"], None]

_OVER = ("stopped", "failed")
_GIVE_UP_S = 40.0


@dataclass
class FromPoller(Message):
    """A snapshot has come, or none comes any more."""

    event: Poller.Arrived | Poller.Lost


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


class Connector:
    """Has at most one attempt under way, and at most one acquisition.

    `defaults`: what an acquisition that is started here has beside port, rate and sampling.
    `tell_finished`: takes the recording that an acquisition finished at its end, and its result.
    """

    def __init__(self, context: AppContext, defaults: Plan, tell_finished: TellFinished) -> None:
        self.defaults = defaults
        self.exit_code = 0  # of the program, if it ends now
        self._context = context
        self._tell_finished = tell_finished
        self._attempt: Attempt | None = None
        self._given_up: list[Attempt] = []

    @property
    def connecting(self) -> bool:
        return self._attempt is not None

    def answer(self, request: requests.ConnectRequest) -> None:
        match request:
            case requests.Start():
                self._start_with(request.changes)
            case requests.StartDemo():
                self._start_demo()
            case requests.Resume():
                self._resume(request.name)
            case requests.LookAt():
                self._context.work(self._look_at_unit(request.name, request.page))
            case requests.StartUnits():
                self._context.work(self._start_units(request))
            case requests.OpenRack():
                self._open_rack(request.batch)
            case requests.Cancel():
                self.give_up()
                self._context.connect_page.ready()

    def _start_with(self, changes: dict[str, Any]) -> None:
        """Start an acquisition with some fields of its plan."""
        # the form shows the highest rate where the plan states none
        if changes["rate_hz"] == MAX_RATE_HZ:
            changes = {**changes, "rate_hz": self.defaults.rate_hz}
        try:
            plan = replace(self.defaults, instrument="", **changes)
        except InputError as error:
            self._context.connect_page.ready(str(error))
            return
        self.start(plan)

    def _start_demo(self) -> None:
        """Start the demo, or look at the one that runs."""
        plan = demo(self.defaults)
        if plan.name in session.running():
            self._resume(plan.name)
        else:
            self.start(plan)

    def _resume(self, name: str) -> None:
        """Look at a running acquisition."""
        self._try(Attempt(lambda: session.attach(name), stops=False), f'acquisition "{name}"')

    def start(self, plan: Plan) -> None:
        """Start the acquisition that a plan describes, and show it once it streams."""
        target = "the virtual instrument" if plan.port == VIRTUAL_PORT else plan.port
        self._try(Attempt(lambda: session.start(plan)), target, plan)

    def _try(self, attempt: Attempt, target: str, plan: Plan | None = None) -> None:
        self._context.work(self._connect(attempt, target, plan))

    async def _connect(self, attempt: Attempt, target: str, plan: Plan | None) -> None:
        self._attempt = attempt
        await self._context.app.switch_mode("connect")
        page = self._context.connect_page
        if plan is not None:
            page.fill(plan)
        page.waiting(target)
        try:
            await in_thread(attempt.run)
        except FAULTS as error:
            if self._attempt is attempt:
                self._attempt = None
                self.exit_code = getattr(error, "exit_code", 4)
                page.ready(messages.fault(error))
            return
        client = attempt.take()
        if client is not None and self._attempt is attempt:
            self._attempt = None
            page.ready()
            self.look_at(client)

    def give_up(self) -> None:
        """Have what is being started stopped once it can be."""
        if self._attempt is not None:
            self._attempt.give_up()
            self._given_up.append(self._attempt)
            self._attempt = None

    def wait(self) -> None:
        """Wait for what was given up, so that it does not run on unseen."""
        for attempt in self._given_up:
            attempt.wait(_GIVE_UP_S)

    # one that runs

    def _open_rack(self, batch: str) -> None:
        """Look at the units of a batch."""
        if self._context.rack is not None:
            self._context.rack.close()
        self._context.rack = Rack(batch)
        self._context.app.call_later(self._context.app.run_action, "page('rack')")

    async def _start_units(self, request: requests.StartUnits) -> None:
        """Start units that do not run: others may be in their places."""
        context, rack = self._context, self._context.rack
        assert rack is not None
        context.say(f"starting {formatting.plural(len(request.names), 'unit')}", "wait")

        async def steps() -> None:
            replies = await in_thread(lambda: rack.start(request.names, self.defaults))
            context.say(*messages.of_several("started", replies))

        try:
            await context.guarded(steps)
        except InputError as error:
            context.say(str(error), "bad")
        request.done()

    async def _look_at_unit(self, name: str, page: str) -> None:
        """Look at a unit of the rack, which goes on if that fails."""

        async def steps() -> None:
            self.look_at(await in_thread(lambda: session.attach(name)), page)

        await self._context.guarded(steps)

    def look_at(self, client: Client, page: str = "live") -> None:
        """Poll an acquisition from now on and bring its readings, or another page, to the front."""
        app = self._context.app
        self.exit_code = 0
        self._context.connection.attach(client, lambda event: app.post_message(FromPoller(event)))
        app.switch_mode(page)
        app.screen.refresh_bindings()

    def take(self, event: Poller.Arrived, draw: Callable[[Poller.Arrived], None]) -> None:
        """Take a snapshot; `draw` draws it if there is time."""
        context = self._context
        if context.connection.owns(event.poller):
            recorded = context.recording is not None
            context.connection.take(event.snapshot, event.history)
            if recorded != (context.recording is not None):
                context.app.screen.refresh_bindings()  # r begins, or finishes
            draw(event)
            if event.snapshot["state"] in _OVER:
                self._ended(None, None)
        event.poller.taken()

    def lost(self, event: Poller.Lost) -> None:
        if self._context.connection.owns(event.poller):
            self._ended(messages.KILLED if event.gone and event.report is None else event.error, event.report)

    def _ended(self, error: str | None, report: EndReport | None) -> None:
        """Say that the acquisition is over, and offer to connect again; its last file stays on the Record page."""
        context, app = self._context, self._context.app
        reason = messages.ended(context.connection.newest, error, report)
        if context.recording is not None and report is not None and report["result"] is not None:
            self._tell_finished(context.recording, report["result"])
        typing = isinstance(app.focused, Input)
        self.release()
        context.connection.over()
        while isinstance(app.screen, ModalScreen):
            app.pop_screen()
        context.say("the acquisition has ended; 1 connects again", "bad")
        app.push_screen(ended_dialog(reason, typing=typing, rack=context.rack is not None), self._after_end)

    def _after_end(self, answer: str | None) -> None:
        if answer == "connect" and not self.connecting:
            back = f"page('{'connect' if self._context.rack is None else 'rack'}')"
            self._context.app.call_later(self._context.app.run_action, back)
        elif answer == "quit":
            self._context.app.call_later(self._context.app.action_quit)  # which asks, if a job runs

    def release(self) -> None:
        """Let go of the client without waiting for it."""
        client = self._context.connection.leave()
        if client is not None:
            in_thread(client.close)


class Leaving:
    """Ends the screen, the acquisition, or both."""

    def __init__(self, context: AppContext, connector: Connector, recorder: RecordingControl) -> None:
        self.farewell: list[str] = []  # lines for the terminal after the UI has gone
        self._context = context
        self._connector = connector
        self._recorder = recorder

    def quit(self) -> None:
        context, app = self._context, self._context.app
        jobs = context.jobs()
        if isinstance(app.screen, ModalScreen):
            app.screen.dismiss(None)
        elif context.rack is not None and (units := context.rack.running()):
            app.push_screen(quit_rack_dialog(context.rack.name, units, jobs), self._after_quit)
        elif context.connection.client is not None:
            app.push_screen(quit_dialog(context.connection.newest, jobs), self._after_quit)
        elif jobs:
            app.push_screen(jobs_dialog(jobs), self._after_jobs)
        else:
            if self._connector.connecting:
                self.farewell.append("The acquisition that was being started is stopped.")
            app.exit(self._connector.exit_code)

    def _after_jobs(self, answer: str | None) -> None:
        if answer == "quit":
            self._context.app.exit(self._connector.exit_code)

    def _after_quit(self, answer: str | None) -> None:
        if answer == "leave":
            self.detach()
        elif answer == "stop":
            self._context.work(self._stop_and_quit())

    def detach(self) -> None:
        if self._context.rack is not None:
            self.farewell += messages.left_rack(self._context.rack.name, len(self._context.rack.running()))
            self._connector.release()
            self._context.app.exit(0)
        elif self._context.connected("detach from"):
            self.farewell += messages.left(self._context.connection.newest)
            self._connector.release()
            self._context.app.exit(0)

    async def _stop_and_quit(self) -> None:
        if self._context.rack is not None:
            await self._stop_rack(self._context.rack)
            return
        error = await self._stop()
        self.farewell.append(error or self._context.connection.notice_text())
        self._context.app.exit(0 if error is None else 4)

    async def _stop_rack(self, rack: Rack) -> None:
        self._context.connection.pause()
        self._context.say("stopping all units: finishing their files", "wait")
        try:
            replies = await in_thread(lambda: session_batch.each(rack.running(), lambda unit: unit.stop("the screen")))
        except FAULTS as error:
            self._context.say(messages.fault(error), "bad")
            return
        said, level = messages.of_several("stopped", replies)
        self.farewell.append(said)
        self._context.app.exit(0 if level == "good" else 4)

    def ask_to_stop(self) -> None:
        if self._context.connection.client is not None:
            self._context.app.push_screen(stop_dialog(self._context.connection.newest), self._after_stop)

    def _after_stop(self, answer: str | None) -> None:
        if answer == "stop":
            self._context.work(self._stop_only())

    async def _stop_only(self) -> None:
        error = await self._stop()
        if error is not None:
            self._context.say(error, "bad")

    async def _stop(self) -> str | None:
        """Stop the acquisition and say so; the error if it ended with one."""
        context, connection, recording = self._context, self._context.connection, self._context.recording
        client = connection.client
        if client is None:
            return None
        connection.pause()
        context.say("stopping: finishing the file" if recording else "stopping the acquisition", "wait")
        try:
            result = (await in_thread(lambda: client.stop("the screen")))["result"]
        except FAULTS as error:
            return messages.fault(error)
        finally:
            self._connector.release()
            connection.over()
        done = [] if recording is None or result is None else [messages.finished(result)]
        self._recorder.tell_page([] if recording is None or result is None else text.finished(recording, result))
        context.say("\n".join([*done, "the acquisition is stopped"]), "good")
        return None
