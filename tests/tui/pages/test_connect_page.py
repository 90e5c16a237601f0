"""The Connect page: first steps, the form, who answers, what is connected."""

import threading
from pathlib import Path
from typing import Any

import pytest
from helpers.fake_client import PATH, FakeClient
from helpers.pilot import opened
from helpers.processes import LIMIT_S
from textual.widgets import Input

from imutui.session import client as session
from imutui.session.client import SessionError
from imutui.session.plan import PAPER_PLACE, Plan, demo
from imutui.session.snapshot import ProbeAnswer
from imutui.tui.pages.connect.form import ConnectForm

FILE = PATH.rsplit("/", 1)[1]


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
    async with opened(None, options={"logs": str(tmp_path)}) as see:
        await see("→ no serial port | press v for the DEMO | virtual, 133 Hz, stream")
        await see("enter → gx, deg/s")
    own = {"site": PAPER_PLACE, "controller": "virtual"}  # it stands on a table that can be commanded
    assert machine == [Plan("virtual", instrument="", logs=str(tmp_path), **own)]


@pytest.mark.parametrize("asks", ["looks for ports", "looks in vain", "asks at a port"])
async def test_what_is_heard_of_ports_after_the_page_has_gone_is_let_go(
    machine: list[Plan], monkeypatch: pytest.MonkeyPatch, asks: str
) -> None:
    """Somebody quits while a thread is still asking; a worker that fails would end the test."""
    async with opened(None) as see:
        await see("→ no serial port")
        form = see.app.screen.query_one(ConnectForm)
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
        await see.until(asked.is_set)
        await form.query("#ports, #lead, #error-text").remove()
        answered.set()
        await see.until(lambda: all(worker.is_finished for worker in see.app.workers))


async def test_the_form_is_filled_with_keys_alone(machine: list[Plan]) -> None:
    async with opened(None) as see:
        await see("→ virtual, 133 Hz")
        await see("tab '/dev/x' tab tab home shift+end delete '0.5' tab right → (x) polled | x, 0.5 Hz, polled")
        await see("enter → Where does the table stand?")
        await see("'59.91,10.75,20' enter → gx, deg/s")
    assert [(p.port, p.rate_hz, p.sampling) for p in machine] == [("/dev/x", 0.5, "polled")]
    assert [p.instrument for p in machine] == [""], "which unit it is, is asked"


async def test_the_configuration_reaches_what_the_form_does_not_ask(machine: list[Plan]) -> None:
    async with opened(None, options={"defaults": Plan("virtual", rate_hz=50.0, mount="x,-y,-z", accel_sign=1)}) as see:
        await see("→ virtual, 50 Hz")
        await see("enter → gx, deg/s")
    own = {"site": PAPER_PLACE, "controller": "virtual"}
    assert machine == [Plan("virtual", instrument="", rate_hz=50.0, mount="x,-y,-z", accel_sign=1, **own)]


async def test_the_site_is_asked_for_once_where_a_filter_would_start_without_one(machine: list[Plan]) -> None:
    async with opened(None) as see:
        await see("→ virtual, 133 Hz")
        await see("tab '/dev/x' enter → Where does the table stand? | ± 7.8 mg")
        assert see.app.focused is not None
        assert see.app.focused.id == "site"
        assert not machine
        await see("'91,0,0' enter → The site is \"91,0,0\": latitude")
        assert not machine
        await see("home shift+end delete '59.91,10.75,20' enter → gx, deg/s")
    assert [plan.site for plan in machine] == [(59.91, 10.75, 20.0)]


async def test_who_does_not_state_the_site_goes_on_without_it(machine: list[Plan]) -> None:
    async with opened(None) as see:
        await see("→ virtual, 133 Hz")
        await see("tab '/dev/x' enter → Where does the table stand?")
        await see("enter → gx, deg/s")
    assert [(plan.site, plan.gravity) for plan in machine] == [(None, None)]


@pytest.mark.parametrize("known", [{"site": (59.91, 10.75, 20.0)}, {"gravity": 9.819}, {"filter": "none"}])
async def test_the_site_is_not_asked_for_where_it_is_known_or_needed_for_nothing(
    machine: list[Plan], known: dict[str, Any]
) -> None:
    async with opened(None, options={"defaults": Plan("virtual", **known)}) as see:
        await see("→ virtual, 133 Hz")
        await see("tab '/dev/x' enter → gx, deg/s")
    assert [{key: getattr(plan, key) for key in known} for plan in machine] == [known]


async def test_a_virtual_unit_stands_where_it_stands_wherever_the_user_does(machine: list[Plan]) -> None:
    there = Plan("virtual", site=(59.91, 10.75, 20.0), gravity=9.819)
    async with opened(None, options={"defaults": there}) as see:
        await see("→ virtual, 133 Hz")
        await see("enter → gx, deg/s")
    assert [(plan.site, plan.gravity) for plan in machine] == [(PAPER_PLACE, None)]


async def test_what_is_connected_says_that_its_site_is_not_stated(machine: list[Plan]) -> None:
    client = FakeClient()
    client.changes |= {"site_stated": False}
    async with opened(client) as see:
        await see("1 → the site is not stated")
        client.changes |= {"site_stated": True}
        await see("→ reference level")
        await see.until(lambda: "not stated" not in see.text())


async def test_v_starts_the_demo_from_the_first_screen(machine: list[Plan], tmp_path: Path) -> None:
    async with opened(None, options={"defaults": Plan("virtual", logs=str(tmp_path), mount="x,-y,-z")}) as see:
        screen = await see("→ press v for the DEMO | estimates its biases | v demo | ? help | q quit")
        assert max(len(line) for line in screen.splitlines()) == 80
        await see("v → gx, deg/s")
    (plan,) = machine
    assert plan == demo(Plan("virtual", logs=str(tmp_path)))
    assert (plan.record, plan.rate_hz, plan.logs, plan.mount) == (True, 20.0, str(tmp_path), "x,y,z")


async def test_a_demo_that_runs_is_shown_again(machine: list[Plan], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session, "running", lambda: ["demo"])
    monkeypatch.setattr(session, "attach", lambda name: FakeClient(name))
    async with opened(None) as see:
        await see("→ An acquisition is running")
        await see("v → gx, deg/s")
    assert machine == []


async def test_a_key_that_needs_an_acquisition_says_what_is_missing(machine: list[Plan]) -> None:
    async with opened(None) as see:
        assert "r record" not in await see.shows("press v for the DEMO")
        await see("r → nothing to record: not connected | v starts the demo")


async def test_ports_are_asked_only_when_told_to(machine: list[Plan], monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []

    def probe(port: str) -> ProbeAnswer:
        asked.append(port)
        answer = session.not_answered(port, f"{port}: in use by picocom (pid 12)")
        if port == "/dev/ttyUSB0":
            return {**answer, "answers": True, "serial_number": "9911750", "firmware": "IMU400CD 1.2", "error": None}
        return answer

    ports = [("/dev/ttyUSB0", "FT232R"), ("/dev/ttyUSB1", "FT232R"), ("/dev/ttyS0", "n/a")]
    monkeypatch.setattr(session, "ports", lambda: ports)
    monkeypatch.setattr(session, "probe", probe)
    async with opened(None) as see:
        await see("→ ttyUSB1 | Choose a port; Enter connects | p probe")
        assert asked == []
        await see("p → IMU400CD 1.2 #9911750")
        assert asked == ["/dev/ttyUSB0"]
        await see("down a → in use by picocom (pid 12)")
        await see.until(lambda: asked == ["/dev/ttyUSB0", *(port for port, _ in ports)])
        await see("→ ttyUSB1, 133 Hz")
        # one that is typed in is the one that is chosen
        see.app.screen.query_one("#port", Input).value = "/dev/pts/77"
        await see("→ pts/77, 133 Hz")
        await see("p →")
        await see.until(lambda: asked[-1] == "/dev/pts/77")
        await see("→ /dev/pts/77: in use by picocom (pid 12)")
    assert machine == []


async def test_a_unit_that_answered_is_offered_what_it_gives(
    machine: list[Plan], monkeypatch: pytest.MonkeyPatch
) -> None:
    answer = {"answers": True, "instrument": "IMU381ZA-200", "serial_number": "17", "firmware": "", "error": ""}
    monkeypatch.setattr(session, "ports", lambda: [("/dev/ttyUSB0", "FT232R")])
    monkeypatch.setattr(session, "probe", lambda port: {"port": port, **answer})
    async with opened(None) as see:
        await see("→ ttyUSB0, 133 Hz | 0.1 to 133 | voltage mode is not used")
        await see("p → IMU381ZA-200 #17 | ttyUSB0, 100 Hz | 0.1 to 100; unaveraged at 2 4 5 10 20 25 50 100")
        assert "packets S1: rates, forces" in see.text()
        await see("down → virtual, 100 Hz | 0.1 to 133 | voltage mode is not used")
        await see("up tab tab tab home shift+end delete '120' → outside 0.1 to 100 Hz")
        await see("enter → The rate is outside 0.1 to 100 Hz.")
        assert machine == []
        await see("home shift+end delete '7' enter → Where does the table stand?")
        await see("enter → gx, deg/s")
    (plan,) = machine
    assert (plan.port, plan.rate_hz) == ("/dev/ttyUSB0", 7.0)


async def test_a_look_that_takes_long_comes_to_its_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is not begun anew each time that one is due, on a busy machine never to be done."""
    released, asked = threading.Event(), []

    def running() -> list[str]:
        asked.append(1)
        released.wait(60.0)
        return ["bench"]

    monkeypatch.setattr(session, "running", running)
    monkeypatch.setattr(session, "ports", list)
    async with opened(None) as see:
        await see.until(lambda: bool(asked))
        for _ in range(3):
            await see("f5 →")
        assert len(asked) == 1
        released.set()
        await see("→ bench")


async def test_filter_and_reference_go_into_the_plan(machine: list[Plan]) -> None:
    async with opened(None) as see:
        await see("→ virtual, 133 Hz")
        await see("tab*5 right down right → (x) spkf-paper | (x) gravity | voltage mode is not used")
        await see("enter → gx, deg/s")
    assert [(p.filter, p.reference) for p in machine] == [("spkf-paper", "gravity")]


async def test_zeroing_asks_and_enter_does_not_do_it() -> None:
    async with opened() as see:
        await see("1 z → Zero the rate sensors? | must stand still | stored is in the instrument | begins anew")
        await see("enter → !Zero the rate sensors?")
        assert see.client.asked == []
        await see("z → Zero the rate sensors?")
        await see("z → rate sensors zeroed")
        assert see.client.asked == ["zero 30"]
        see.client.recording = True
        await see("→ ● REC")
        await see("z → not while recording")
        assert see.client.asked == ["zero 30"]


async def test_a_unit_without_a_command_that_zeroes_is_not_offered_it() -> None:
    async with opened(instrument="IMU381ZA-200") as see:
        await see("1 → stop")
        assert "zero" not in see.text()
        await see("z →")
        assert len(see.app.screen_stack) == 1
        assert see.client.asked == []


async def test_an_impossible_rate_is_said_while_typing_and_not_sent(machine: list[Plan]) -> None:
    async with opened(None) as see:
        await see("→ virtual, 133 Hz")
        await see("tab tab tab end 4 → outside 0.1 to 133 Hz")
        await see("enter → The rate is outside 0.1 to 133 Hz")
    assert machine == []


async def test_a_failed_start_shows_the_whole_reason(machine: list[Plan], monkeypatch: pytest.MonkeyPatch) -> None:
    reason = "/dev/ttyUSB7 is not there. Ports of this machine: none. Plug the adapter in, then press Enter."

    def fail(plan: Plan) -> FakeClient:
        raise SessionError(reason, 4)

    monkeypatch.setattr(session, "start", fail)
    async with opened(None, options={"plan": Plan("/dev/ttyUSB7", rate_hz=20.0)}) as see:
        screen = await see("→ Could not connect. | press Enter.")
        assert " ".join(screen.split()).find(reason) > 0
        assert "ttyUSB7, 20 Hz, stream" in screen
        await see("ctrl+q →")
        await see.until(lambda: see.app._exit)
    assert see.app.return_value == 4


async def test_a_running_acquisition_is_offered_first(machine: list[Plan], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session, "running", lambda: ["default"])
    monkeypatch.setattr(session, "attach", lambda name: FakeClient(name))
    async with opened(None) as see:
        await see('→ running acquisition "default"')
        await see("enter → gx, deg/s")
    assert machine == []


async def test_an_acquisition_that_begins_meanwhile_is_what_enter_takes(
    machine: list[Plan], monkeypatch: pytest.MonkeyPatch
) -> None:
    running: list[str] = []
    monkeypatch.setattr(session, "running", lambda: list(running))
    monkeypatch.setattr(session, "attach", lambda name: FakeClient(name))
    async with opened(None) as see:
        await see("→ virtual, 133 Hz")
        running.append("default")
        await see('→ An acquisition is running | looks at the running acquisition "default"')
        await see("down → Connect | 133 Hz, stream")
        running.append("other")
        await see('→ running acquisition "other"')
        await see("→ 133 Hz, stream")
    assert machine == []


async def test_the_connected_page_stops_only_after_asking() -> None:
    async with opened(recording=True) as see:
        await see("1 → Connected | /dev/serial/by-id | stop this acquisition")
        await see(f"s → Stop this acquisition? | {FILE}")
        assert see.client.asked == []
        await see(f"s → other port | finished {PATH}")
    assert see.client.asked == ["stop"]
