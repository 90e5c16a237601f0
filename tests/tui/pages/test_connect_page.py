"""The Connect page: first steps, the form, who answers, what is connected."""

import threading
from pathlib import Path

import pytest
from helpers.fake_client import PATH, FakeClient
from helpers.pilot import SMALLEST, shows, text_of, until
from helpers.processes import LIMIT_S
from textual.widgets import Input

from imutui.session import client as session
from imutui.session.client import SessionError
from imutui.session.plan import Plan, demo
from imutui.tui.app import ImutuiApp
from imutui.tui.pages.connect.form import ConnectForm

FILE = PATH.rsplit("/", 1)[1]


def _app(client: FakeClient | None) -> ImutuiApp:
    return ImutuiApp(client)  # type: ignore[arg-type]


@pytest.fixture
def machine(monkeypatch: pytest.MonkeyPatch) -> list[Plan]:
    """A machine without ports, where every start succeeds; returns the plans that were started."""
    plans: list[Plan] = []

    def start(plan: Plan) -> FakeClient:
        plans.append(plan)
        return FakeClient()

    monkeypatch.setattr(session, "running", list)
    monkeypatch.setattr(session, "ports", list)
    monkeypatch.setattr(session, "start", start)
    return plans


async def test_enter_tries_the_virtual_instrument(machine: list[Plan], tmp_path: Path) -> None:
    app = ImutuiApp(logs=str(tmp_path))
    async with app.run_test(size=SMALLEST) as pilot:
        await shows(pilot, "no serial port", "press v for the DEMO", "virtual, 133 Hz, stream")
        await pilot.press("enter")
        await shows(pilot, "gx, deg/s")
    assert machine == [Plan("virtual", 133.0, "stream", logs=str(tmp_path))]


@pytest.mark.parametrize("asks", ["looks for ports", "looks in vain", "asks at a port"])
async def test_what_is_heard_of_ports_after_the_page_has_gone_is_let_go(
    machine: list[Plan], monkeypatch: pytest.MonkeyPatch, asks: str
) -> None:
    """Somebody quits while a thread is still asking; a worker that fails would end the test."""
    async with _app(None).run_test(size=SMALLEST) as pilot:
        await shows(pilot, "no serial port")
        form = pilot.app.screen.query_one(ConnectForm)
        asked, answered = threading.Event(), threading.Event()

        def ask(*_: str) -> list[str]:
            asked.set()
            answered.wait(LIMIT_S)
            if asks == "looks for ports":
                return ["default"]
            raise OSError("no such device")

        monkeypatch.setattr(session, "running", ask)
        monkeypatch.setattr(session, "probe", ask)
        if asks == "asks at a port":
            form._probe(["/dev/ttyUSB0"])
        else:
            form.look()
        await until(pilot, asked.is_set)
        await form.query("#ports, #lead, #error-text").remove()
        answered.set()
        await until(pilot, lambda: all(worker.is_finished for worker in pilot.app.workers))


async def test_the_form_is_filled_with_keys_alone(machine: list[Plan]) -> None:
    async with _app(None).run_test(size=SMALLEST) as pilot:
        await shows(pilot, "virtual, 133 Hz")
        await pilot.press("tab", *"/dev/x", "tab", "home", "shift+end", "delete", *"0.5", "tab", "right")
        await shows(pilot, "(x) polled", "x, 0.5 Hz, polled")
        await pilot.press("enter")
        await shows(pilot, "gx, deg/s")
    assert [(p.port, p.rate_hz, p.sampling) for p in machine] == [("/dev/x", 0.5, "polled")]
    assert [p.instrument for p in machine] == [""], "which unit it is, is asked"


async def test_the_configuration_reaches_what_the_form_does_not_ask(machine: list[Plan]) -> None:
    app = ImutuiApp(defaults=Plan("virtual", 50.0, mount="x,-y,-z", accel_sign=1))
    async with app.run_test(size=SMALLEST) as pilot:
        await shows(pilot, "virtual, 50 Hz")
        await pilot.press("enter")
        await shows(pilot, "gx, deg/s")
    assert machine == [Plan("virtual", 50.0, mount="x,-y,-z", accel_sign=1)]


async def test_v_starts_the_demo_from_the_first_screen(machine: list[Plan], tmp_path: Path) -> None:
    app = ImutuiApp(defaults=Plan("virtual", logs=str(tmp_path), mount="x,-y,-z"))
    async with app.run_test(size=SMALLEST) as pilot:
        screen = await shows(pilot, "press v for the DEMO", "estimates its biases", "v demo", "? help", "q quit")
        assert max(len(line) for line in screen.splitlines()) == 80
        await pilot.press("v")
        await shows(pilot, "gx, deg/s")
    (plan,) = machine
    assert plan == demo(Plan("virtual", logs=str(tmp_path)))
    assert (plan.record, plan.rate_hz, plan.logs, plan.mount) == (True, 20.0, str(tmp_path), "x,y,z")


async def test_a_demo_that_runs_is_shown_again(machine: list[Plan], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session, "running", lambda: ["demo"])
    monkeypatch.setattr(session, "attach", lambda name, stays: FakeClient(name))
    async with _app(None).run_test(size=SMALLEST) as pilot:
        await shows(pilot, "An acquisition is running")
        await pilot.press("v")
        await shows(pilot, "gx, deg/s")
    assert machine == []


async def test_a_key_that_needs_an_acquisition_says_what_is_missing(machine: list[Plan]) -> None:
    async with _app(None).run_test(size=SMALLEST) as pilot:
        assert "r record" not in await shows(pilot, "press v for the DEMO")
        await pilot.press("r")
        await shows(pilot, "nothing to record: not connected", "v starts the demo")


async def test_ports_are_asked_only_when_told_to(machine: list[Plan], monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []

    def probe(port: str) -> dict[str, object]:
        asked.append(port)
        if port == "/dev/ttyUSB0":
            return {"port": port, "answers": True, "serial_number": "9911750", "firmware": "IMU400CD 1.2", "error": ""}
        return {"port": port, "answers": False, "error": f"{port}: in use by picocom (pid 12)"}

    ports = [("/dev/ttyUSB0", "FT232R"), ("/dev/ttyUSB1", "FT232R"), ("/dev/ttyS0", "n/a")]
    monkeypatch.setattr(session, "ports", lambda: ports)
    monkeypatch.setattr(session, "probe", probe)
    async with _app(None).run_test(size=SMALLEST) as pilot:
        await shows(pilot, "ttyUSB1", "Choose a port; Enter connects", "p probe")
        assert asked == []
        await pilot.press("p")
        await shows(pilot, "IMU400CD 1.2 #9911750")
        assert asked == ["/dev/ttyUSB0"]
        await pilot.press("down", "a")
        await shows(pilot, "in use by picocom (pid 12)")
        await until(pilot, lambda: asked == ["/dev/ttyUSB0", *(port for port, _ in ports)])
        await shows(pilot, "ttyUSB1, 133 Hz")
        # one that is typed in is the one that is chosen
        pilot.app.screen.query_one("#port", Input).value = "/dev/pts/77"
        await shows(pilot, "pts/77, 133 Hz")
        await pilot.press("p")
        await until(pilot, lambda: asked[-1] == "/dev/pts/77")
        await shows(pilot, "/dev/pts/77: in use by picocom (pid 12)")
    assert machine == []


async def test_a_unit_that_answered_is_offered_what_it_gives(
    machine: list[Plan], monkeypatch: pytest.MonkeyPatch
) -> None:
    answer = {"answers": True, "instrument": "IMU381ZA-200", "serial_number": "17", "firmware": "", "error": ""}
    monkeypatch.setattr(session, "ports", lambda: [("/dev/ttyUSB0", "FT232R")])
    monkeypatch.setattr(session, "probe", lambda port: {"port": port, **answer})
    async with _app(None).run_test(size=SMALLEST) as pilot:
        await shows(pilot, "ttyUSB0, 133 Hz", "0.1 to 133", "voltage mode is not used")
        await pilot.press("p")
        await shows(pilot, "IMU381ZA-200 #17", "ttyUSB0, 100 Hz", "0.1 to 100; unaveraged at 2 4 5 10 20 25 50 100")
        assert "packets S1: rates, forces" in text_of(pilot.app)
        await pilot.press("down")
        await shows(pilot, "virtual, 100 Hz", "0.1 to 133", "voltage mode is not used")
        await pilot.press("up", "tab", "tab", "home", "shift+end", "delete", *"120")
        await shows(pilot, "outside 0.1 to 100 Hz")
        await pilot.press("enter")
        await shows(pilot, "The rate is outside 0.1 to 100 Hz.")
        assert machine == []
        await pilot.press("home", "shift+end", "delete", *"7", "enter")
        await shows(pilot, "gx, deg/s")
    (plan,) = machine
    assert (plan.port, plan.rate_hz, plan.explicit) == ("/dev/ttyUSB0", 7.0, ("rate_hz",))


async def test_a_look_that_takes_long_comes_to_its_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is not begun anew each time that one is due, on a busy machine never to be done."""
    released, asked = threading.Event(), []

    def running() -> list[str]:
        asked.append(1)
        released.wait(60.0)
        return ["bench"]

    monkeypatch.setattr(session, "running", running)
    monkeypatch.setattr(session, "ports", list)
    app = _app(None)
    async with app.run_test(size=SMALLEST) as pilot:
        await until(pilot, lambda: bool(asked))
        for _ in range(3):
            await pilot.press("f5")
        assert len(asked) == 1
        released.set()
        await shows(pilot, "bench")


async def test_filter_and_reference_go_into_the_plan(machine: list[Plan]) -> None:
    async with _app(None).run_test(size=SMALLEST) as pilot:
        await shows(pilot, "virtual, 133 Hz")
        await pilot.press(*("tab",) * 4, "right", "down", "right")
        await shows(pilot, "(x) spkf-paper", "(x) gravity", "voltage mode is not used")
        await pilot.press("enter")
        await shows(pilot, "gx, deg/s")
    assert [(p.filter, p.reference) for p in machine] == [("spkf-paper", "gravity")]


async def test_zeroing_asks_and_enter_does_not_do_it() -> None:
    client = FakeClient()
    async with _app(client).run_test(size=SMALLEST) as pilot:
        await shows(pilot, "SIMULATED")
        await pilot.press("1", "z")
        await shows(pilot, "Zero the rate sensors?", "must stand still", "stored is in the instrument", "begins anew")
        await pilot.press("enter")
        await until(pilot, lambda: "Zero the rate sensors?" not in text_of(pilot.app))  # type: ignore[arg-type]
        assert client.asked == []
        await pilot.press("z")
        await shows(pilot, "Zero the rate sensors?")
        await pilot.press("z")
        await shows(pilot, "rate sensors zeroed")
        assert client.asked == ["zero 30"]
        client.recording = True
        await shows(pilot, "● REC")
        await pilot.press("z")
        await shows(pilot, "not while recording")
        assert client.asked == ["zero 30"]


async def test_a_unit_without_a_command_that_zeroes_is_not_offered_it() -> None:
    client = FakeClient()
    client.changes["instrument"] = "IMU381ZA-200"
    async with _app(client).run_test(size=SMALLEST) as pilot:
        await shows(pilot, "SIMULATED")
        await pilot.press("1")
        await shows(pilot, "stop")
        assert "zero" not in text_of(pilot.app)
        await pilot.press("z")
        assert len(pilot.app.screen_stack) == 1
        assert client.asked == []


async def test_an_impossible_rate_is_said_while_typing_and_not_sent(machine: list[Plan]) -> None:
    async with _app(None).run_test(size=SMALLEST) as pilot:
        await shows(pilot, "virtual, 133 Hz")
        await pilot.press("tab", "tab", "end", "4")
        await shows(pilot, "outside 0.1 to 133 Hz")
        await pilot.press("enter")
        await shows(pilot, "The rate is outside 0.1 to 133 Hz")
    assert machine == []


async def test_a_failed_start_shows_the_whole_reason(machine: list[Plan], monkeypatch: pytest.MonkeyPatch) -> None:
    reason = "/dev/ttyUSB7 is not there. Ports of this machine: none. Plug the adapter in, then press Enter."

    def fail(plan: Plan) -> FakeClient:
        raise SessionError(reason, 4)

    monkeypatch.setattr(session, "start", fail)
    app = ImutuiApp(plan=Plan("/dev/ttyUSB7", 20.0))
    async with app.run_test(size=SMALLEST) as pilot:
        screen = await shows(pilot, "Could not connect.", "press Enter.")
        assert " ".join(screen.split()).find(reason) > 0
        assert "ttyUSB7, 20 Hz, stream" in screen
        await pilot.press("ctrl+q")
        await until(pilot, lambda: app._exit)
    assert app.return_value == 4


async def test_a_running_acquisition_is_offered_first(machine: list[Plan], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session, "running", lambda: ["default"])
    monkeypatch.setattr(session, "attach", lambda name, stays: FakeClient(name))
    async with _app(None).run_test(size=SMALLEST) as pilot:
        await shows(pilot, 'running acquisition "default"')
        await pilot.press("enter")
        await shows(pilot, "gx, deg/s")
    assert machine == []


async def test_an_acquisition_that_begins_meanwhile_is_what_enter_takes(
    machine: list[Plan], monkeypatch: pytest.MonkeyPatch
) -> None:
    running: list[str] = []
    monkeypatch.setattr(session, "running", lambda: list(running))
    monkeypatch.setattr(session, "attach", lambda name, stays: FakeClient(name))
    async with _app(None).run_test(size=SMALLEST) as pilot:
        await shows(pilot, "virtual, 133 Hz")
        running.append("default")
        await shows(pilot, "An acquisition is running", 'looks at the running acquisition "default"')
        await pilot.press("down")
        await shows(pilot, "Connect", "133 Hz, stream")
        running.append("other")
        await shows(pilot, 'running acquisition "other"')
        await shows(pilot, "133 Hz, stream")
    assert machine == []


async def test_the_connected_page_stops_only_after_asking() -> None:
    client = FakeClient()
    client.recording = True
    async with _app(client).run_test(size=SMALLEST) as pilot:
        await shows(pilot, "● REC")
        await pilot.press("1")
        await shows(pilot, "Connected", "/dev/serial/by-id", "stop this acquisition")
        await pilot.press("s")
        await shows(pilot, "Stop this acquisition?", FILE)
        assert client.asked == []
        await pilot.press("s")
        await shows(pilot, "other port", f"finished {PATH}")
    assert client.asked == ["stop"]
