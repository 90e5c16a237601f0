"""The application at 80×24, driven by keys."""

from pathlib import Path

import pytest
from fake import PATH, FakeClient
from pilot import SMALLEST, shows, text_of, until

from imutui.session.client import SessionError
from imutui.session.plan import Plan, demo
from imutui.tui import app as application
from imutui.tui.app import ImutuiApp
from imutui.tui.look import Look
from imutui.tui.screens import PAGES

FILE = PATH.rsplit("/", 1)[1]


def _app(client: FakeClient | None) -> ImutuiApp:
    return ImutuiApp(client)  # type: ignore[arg-type]


async def test_live_has_every_vital_text_at_80x24() -> None:
    """Nothing is cut: identity, origin, numbers, plot, rates, losses, warm-up, file, keys."""
    client = FakeClient()
    client.recording = True
    async with _app(client).run_test(size=SMALLEST) as pilot:
        screen = await shows(pilot, "IMU400CD-200 #9911750", "SIMULATED", "● REC 0:1", "10:43:07 UTC", " gx  ", " T  ")
        for text in (
            "deg/s", " mg ", "°C", "counts", "mean", "sd", "min", "max", "gyro, deg/s", "last 30 s", "autoscale",
            "asked 20 measured 20.00 Hz", "lost 0", "bad sums 0", "warming 3 min", FILE, "123 kB", "flush 0.4 s ago",
            "q quit", "? help", "r record", "filter ▲ AMBER 5 of 6", "0.3461", "1000.981",
        ):  # fmt: skip
            assert text in screen, text


async def test_a_measured_unit_is_not_called_simulated() -> None:
    """The label is for simulated units only."""
    async with _app(FakeClient(kind="measured")).run_test(size=SMALLEST) as pilot:
        assert "SIMULATED" not in await shows(pilot, "IMU400CD-200")


@pytest.mark.parametrize("size", [SMALLEST, (120, 40)])
async def test_every_line_of_every_page_fits(size: tuple[int, int]) -> None:
    """No page is higher or wider than its terminal, and its footer is whole."""
    client = FakeClient()
    client.recording = True
    async with _app(client).run_test(size=size) as pilot:
        await shows(pilot, "SIMULATED")
        for key, _ in PAGES:
            await pilot.press(key)
            lines = (await shows(pilot, "q quit")).splitlines()
            assert len(lines) == size[1]
            assert "q quit" in lines[-1]
            assert max(widget.region.bottom for widget in pilot.app.screen.query("#page > *")) <= size[1]


async def test_a_tall_terminal_shows_both_plots() -> None:
    """Height adds the accelerometers, width adds events; the other plot's key is gone."""
    async with _app(FakeClient()).run_test(size=(120, 40)) as pilot:
        screen = await shows(pilot, "gyro, deg/s", "accel, mg", "events, UTC", "started at 20 Hz")
        assert "g accel" not in screen


async def test_a_small_terminal_says_what_it_needs() -> None:
    """Below 80×24 there is a message instead of a broken page, and it goes away with more room."""
    async with _app(FakeClient()).run_test(size=(79, 24)) as pilot:
        assert "gyro" not in await shows(pilot, "needs 80x24", "79x24")
        await pilot.resize_terminal(*SMALLEST)
        await shows(pilot, "gyro, deg/s")
        await pilot.resize_terminal(100, 20)
        await shows(pilot, "needs 80x24", "100x20")


async def test_no_color_loses_no_state(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every state is a word: the same texts stand there without colour, and the plot is drawn."""
    monkeypatch.setenv("NO_COLOR", "1")
    client = FakeClient()
    client.recording = True
    async with _app(client).run_test(size=SMALLEST) as pilot:
        screen = await shows(pilot, "SIMULATED", "● REC", "AMBER 5 of 6", "⣿")
        assert "lost 0" in screen
        await pilot.press("4")
        await shows(pilot, "AMBER", "not yet")
        await pilot.press("q")
        await shows(pilot, "recording continues")


async def test_ascii_terminals_get_ascii(monkeypatch: pytest.MonkeyPatch) -> None:
    """With IMUTUI_SCREEN_GLYPHS=ascii, no page and no dialog has another sign."""
    monkeypatch.setenv("IMUTUI_SCREEN_GLYPHS", "ascii")
    client = FakeClient()
    client.recording = True
    async with _app(client).run_test(size=SMALLEST) as pilot:
        assert (await shows(pilot, "* REC", "gyro, deg/s")).isascii()
        for keys, text in (
            ("4", "+-0.0291"),
            ("3", "RECORDING"),
            ("5", "5 Table"),
            ("6", "6 Logs"),
            ("1", "Connected"),
        ):
            await pilot.press(keys)
            assert (await shows(pilot, text)).isascii(), text_of(pilot.app)  # type: ignore[arg-type]
        await pilot.press("q")
        assert (await shows(pilot, "continues")).isascii()


async def test_r_records_and_says_which_file_it_finished() -> None:
    """The first r begins a file, the second one finishes it and names it."""
    client = FakeClient()
    async with _app(client).run_test(size=SMALLEST) as pilot:
        await shows(pilot, "not recording: r writes")
        await pilot.press("r")
        await shows(pilot, f"recording to {PATH}", "● REC")
        await pilot.press("r")
        await shows(pilot, f"finished {PATH}, 15246 samples", "not recording")
        assert client.asked == ["record", "stop_recording"]


async def test_a_refusal_is_said() -> None:
    """An error of the acquisition reaches the screen as it is."""
    client = FakeClient()

    def refuse(note: str = "") -> str:
        raise SessionError("the disk is full: 12 MB left")

    client.record = refuse  # type: ignore[method-assign]
    async with _app(client).run_test(size=SMALLEST) as pilot:
        await shows(pilot, "SIMULATED")
        await pilot.press("r")
        await shows(pilot, "the disk is full: 12 MB left")


async def test_m_marks_a_recording() -> None:
    """The text goes to the acquisition; letters that are keys elsewhere are text here."""
    client = FakeClient()
    client.recording = True
    async with _app(client).run_test(size=SMALLEST) as pilot:
        await shows(pilot, "● REC")
        await pilot.press("m")
        await shows(pilot, "Mark in the recording")
        await pilot.press(*"rq 1", "enter")
        await shows(pilot, "marked: rq 1")
        assert client.asked == ["mark rq 1"]


async def test_m_without_a_recording_says_why_not() -> None:
    """There is nothing to mark, and the page says how to change that."""
    client = FakeClient()
    async with _app(client).run_test(size=SMALLEST) as pilot:
        await shows(pilot, "not recording: r writes")
        await pilot.press("m")
        await shows(pilot, "nothing to mark: r starts a recording")
        assert client.asked == []


async def test_space_freezes_the_view_and_not_the_data() -> None:
    """The polls go on, the numbers stand still, the state is a word, Esc follows again."""
    client = FakeClient()
    async with _app(client).run_test(size=SMALLEST) as pilot:
        await shows(pilot, "SIMULATED")
        await pilot.press("space")
        frozen = (await shows(pilot, "FROZEN")).splitlines()[2:20]
        polls = client.polls
        await until(pilot, lambda: client.polls > polls + 3)
        assert text_of(pilot.app).splitlines()[2:20] == frozen  # type: ignore[arg-type]
        await pilot.press("escape")
        await until(pilot, lambda: "FROZEN" not in text_of(pilot.app))  # type: ignore[arg-type]


async def test_span_lock_and_other_plot() -> None:
    """Plus and minus change the span, a locks the scale, g shows the accelerometers."""
    async with _app(FakeClient()).run_test(size=SMALLEST) as pilot:
        await shows(pilot, "last 30 s, autoscale")
        await pilot.press("plus")
        await shows(pilot, "last 60 s")
        await pilot.press("minus", "minus", "minus")
        await shows(pilot, "last 5 s")
        await pilot.press("a")
        await shows(pilot, "scale locked")
        await pilot.press("a", "g")
        await shows(pilot, "accel, mg", "autoscale")


async def test_quitting_while_recording_says_what_goes_on() -> None:
    """Cancel stays; leave detaches, and recording goes on."""
    client = FakeClient()
    client.recording = True
    app = _app(client)
    async with app.run_test(size=SMALLEST) as pilot:
        await shows(pilot, "● REC")
        await pilot.press("q")
        await shows(pilot, FILE, "recording continues in the background", "finish the file", "cancel")
        await pilot.press("escape")
        await shows(pilot, "gyro, deg/s")
        await pilot.press("q")
        await shows(pilot, "recording continues")
        await pilot.press("l")
        await until(pilot, lambda: app._exit)
    assert app.return_value == 0
    assert client.asked == []
    assert client.recording
    assert "imutui attach" in app.farewell[1]
    assert PATH in app.farewell[0]


async def test_stop_and_quit_finishes_the_file() -> None:
    """The acquisition is stopped, and the terminal says which file was finished."""
    client = FakeClient()
    client.recording = True
    app = _app(client)
    async with app.run_test(size=SMALLEST) as pilot:
        await shows(pilot, "● REC")
        await pilot.press("q", "s")
        await until(pilot, lambda: app._exit)
    assert client.asked == ["stop"]
    assert f"finished {PATH}" in app.farewell[0]


async def test_control_keys_never_kill_a_recording() -> None:
    """They ask as q does; pressed again they cancel."""
    client = FakeClient()
    client.recording = True
    app = _app(client)
    async with app.run_test(size=SMALLEST) as pilot:
        await shows(pilot, "● REC")
        for key in ("ctrl+c", "ctrl+q"):
            await pilot.press(key)
            await shows(pilot, "recording continues")
            await pilot.press(key)
            await shows(pilot, "gyro, deg/s")
        assert not app._exit
    assert client.asked == []


async def test_d_detaches() -> None:
    """The UI ends, the acquisition does not, and the terminal says how to come back."""
    client = FakeClient(name="bench")
    app = _app(client)
    async with app.run_test(size=SMALLEST) as pilot:
        await shows(pilot, "SIMULATED")
        await pilot.press("d")
        await until(pilot, lambda: app._exit)
    assert client.asked == []
    assert "imutui attach --name bench" in app.farewell[1]


@pytest.mark.parametrize("dialog", [[], ["q"]])
async def test_an_acquisition_that_ends_is_said_at_once(dialog: list[str]) -> None:
    """The error is shown, whatever dialog is open, nothing claims to record, and connecting is offered."""
    client = FakeClient()
    client.recording = True
    async with _app(client).run_test(size=SMALLEST) as pilot:
        await shows(pilot, "● REC")
        await pilot.press(*dialog)
        client.gone = "the cable was pulled"
        await shows(pilot, "The acquisition has ended", "the cable was pulled", PATH[:20])
        await pilot.press("c")
        screen = await shows(pilot, "other port")
        assert "REC" not in screen


async def test_a_failed_state_is_an_end_too() -> None:
    """A last snapshot that says failed is enough."""
    client = FakeClient()
    async with _app(client).run_test(size=SMALLEST) as pilot:
        await shows(pilot, "SIMULATED")
        client.changes.update(state="failed", error="no space left on the disk")
        await shows(pilot, "The acquisition has ended", "no space left on the disk")
        await pilot.press("v")
        await shows(pilot, "ENDED", "gyro, deg/s")


async def test_silence_is_an_alarm() -> None:
    """A dead line is said in words, with what to do."""
    client = FakeClient()
    client.changes["silent_s"] = 3.2
    async with _app(client).run_test(size=SMALLEST) as pilot:
        await shows(pilot, "NO DATA for 3.2 s: check power and cable")


async def test_unknown_numbers_are_dashes() -> None:
    """The first snapshot knows almost nothing, and nothing breaks."""
    client = FakeClient(history_s=0.0)
    client.changes.update(
        measured_hz=None, packet_hz=None, channels=[], filter=None, events=[], series={"next": 0, "t": [], "values": []}
    )
    async with _app(client).run_test(size=SMALLEST) as pilot:
        await shows(pilot, "measured – Hz", " gx          –", "filter – OFF")
        await pilot.press("4")
        await shows(pilot, "OFF", "nothing is estimated")


async def test_help_is_plain_and_closes() -> None:
    """Both keys open it, Esc goes back."""
    async with _app(FakeClient()).run_test(size=SMALLEST) as pilot:
        await shows(pilot, "SIMULATED")
        for key in ("question_mark", "f1"):
            await pilot.press(key)
            await shows(pilot, "never costs a sample", "start a recording")
            await pilot.press("escape")
            await shows(pilot, "gyro, deg/s")


async def test_the_palette_has_every_action_with_its_key() -> None:
    """What a key does can be found by name."""
    app = _app(FakeClient())
    async with app.run_test(size=SMALLEST) as pilot:
        await shows(pilot, "SIMULATED")
        commands = {command.title: command.help for command in app.get_system_commands(app.screen)}
        keys = set(commands.values())
        assert {
            f"key {key}" for key in (*"123456", "r", "m", "d", "y", "P", "?", "q", "Ctrl-z", "space", "a", "g", "+/-")
        } <= keys


@pytest.fixture
def machine(monkeypatch: pytest.MonkeyPatch) -> list[Plan]:
    """A machine without ports, where every start succeeds; returns the plans that were started."""
    plans: list[Plan] = []

    def start(plan: Plan) -> FakeClient:
        plans.append(plan)
        return FakeClient()

    monkeypatch.setattr(application.session, "running", list)
    monkeypatch.setattr(application.session, "ports", list)
    monkeypatch.setattr(application.session, "start", start)
    return plans


async def test_enter_tries_the_virtual_instrument(machine: list[Plan], tmp_path: Path) -> None:
    """On a machine without a port, Enter leads to live numbers, not recorded."""
    app = ImutuiApp(logs=str(tmp_path))
    async with app.run_test(size=SMALLEST) as pilot:
        await shows(pilot, "no serial port", "press v for the DEMO", "virtual, 133 Hz, stream")
        await pilot.press("enter")
        await shows(pilot, "gyro, deg/s")
    assert machine == [Plan("virtual", 133.0, "stream", logs=str(tmp_path))]


async def test_the_form_is_filled_with_keys_alone(machine: list[Plan]) -> None:
    """Tab goes through port, rate and sampling; Enter connects."""
    async with _app(None).run_test(size=SMALLEST) as pilot:
        await shows(pilot, "virtual, 133 Hz")
        await pilot.press("tab", *"/dev/x", "tab", "home", "shift+end", "delete", *"0.5", "tab", "right")
        await shows(pilot, "(x) polled", "x, 0.5 Hz, polled")
        await pilot.press("enter")
        await shows(pilot, "gyro, deg/s")
    assert [(p.port, p.rate_hz, p.sampling) for p in machine] == [("/dev/x", 0.5, "polled")]


async def test_the_configuration_reaches_what_the_form_does_not_ask(machine: list[Plan]) -> None:
    """Signs and mounting are the configuration's; its rate stands in the form."""
    app = ImutuiApp(defaults=Plan("virtual", 50.0, mount="x,-y,-z", accel_sign=1))
    async with app.run_test(size=SMALLEST) as pilot:
        await shows(pilot, "virtual, 50 Hz")
        await pilot.press("enter")
        await shows(pilot, "gyro, deg/s")
    assert machine == [Plan("virtual", 50.0, mount="x,-y,-z", accel_sign=1)]


async def test_v_starts_the_demo_from_the_first_screen(machine: list[Plan], tmp_path: Path) -> None:
    """One key on a fresh machine: a virtual instrument, recorded from its first packet, in the configured folder."""
    app = ImutuiApp(defaults=Plan("virtual", logs=str(tmp_path), mount="x,-y,-z"))
    async with app.run_test(size=SMALLEST) as pilot:
        screen = await shows(pilot, "press v for the DEMO", "estimates its biases", "v demo", "? help", "q quit")
        assert max(len(line) for line in screen.splitlines()) == 80
        await pilot.press("v")
        await shows(pilot, "gyro, deg/s")
    (plan,) = machine
    assert plan == demo(Plan("virtual", logs=str(tmp_path)))
    assert (plan.record, plan.rate_hz, plan.logs, plan.mount) == (True, 20.0, str(tmp_path), "x,y,z")


async def test_a_demo_that_runs_is_shown_again(machine: list[Plan], monkeypatch: pytest.MonkeyPatch) -> None:
    """A second v starts nothing."""
    monkeypatch.setattr(application.session, "running", lambda: ["demo"])
    monkeypatch.setattr(application.session, "attach", FakeClient)
    async with _app(None).run_test(size=SMALLEST) as pilot:
        await shows(pilot, "An acquisition is running")
        await pilot.press("v")
        await shows(pilot, "gyro, deg/s")
    assert machine == []


async def test_a_key_that_needs_an_acquisition_says_what_is_missing(machine: list[Plan]) -> None:
    """It is not in the footer, and still answers with the next step."""
    async with _app(None).run_test(size=SMALLEST) as pilot:
        assert "r record" not in await shows(pilot, "press v for the DEMO")
        await pilot.press("r")
        await shows(pilot, "nothing to record: no acquisition is connected", "v starts the demo")


async def test_ports_are_asked_only_when_told_to(machine: list[Plan], monkeypatch: pytest.MonkeyPatch) -> None:
    """Looking sends nothing; p asks on the chosen port, a on all, and the answers stand in the list."""
    asked: list[str] = []

    def probe(port: str) -> dict[str, object]:
        asked.append(port)
        if port == "/dev/ttyUSB0":
            return {"port": port, "answers": True, "serial_number": "9911750", "firmware": "IMU400CD 1.2", "error": ""}
        return {"port": port, "answers": False, "error": f"{port}: in use by picocom (pid 12)"}

    ports = [("/dev/ttyUSB0", "FT232R"), ("/dev/ttyUSB1", "FT232R"), ("/dev/ttyS0", "n/a")]
    monkeypatch.setattr(application.session, "ports", lambda: ports)
    monkeypatch.setattr(application.session, "probe", probe)
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
    assert machine == []


async def test_filter_and_reference_go_into_the_plan(machine: list[Plan]) -> None:
    """They are chosen with the arrows, each in its own line."""
    async with _app(None).run_test(size=SMALLEST) as pilot:
        await shows(pilot, "virtual, 133 Hz")
        await pilot.press(*("tab",) * 4, "right", "down", "right")
        await shows(pilot, "(x) spkf-paper", "(x) gravity", "voltage mode is not used")
        await pilot.press("enter")
        await shows(pilot, "gyro, deg/s")
    assert [(p.filter, p.reference) for p in machine] == [("spkf-paper", "gravity")]


async def test_zeroing_asks_and_enter_does_not_do_it() -> None:
    """The dialog says what is stored where; Enter cancels, z does it; while recording it is refused."""
    client = FakeClient()
    async with _app(client).run_test(size=SMALLEST) as pilot:
        await shows(pilot, "SIMULATED")
        await pilot.press("1", "z")
        await shows(pilot, "Zero the rate sensors?", "must stand still", "stored is in the instrument", "begins anew")
        await pilot.press("enter")
        await shows(pilot, "Connected.")
        assert client.asked == []
        await pilot.press("z", "z")
        await shows(pilot, "rate sensors zeroed")
        assert client.asked == ["zero 30"]
        client.recording = True
        await shows(pilot, "● REC")
        await pilot.press("z")
        await shows(pilot, "not while recording")
        assert client.asked == ["zero 30"]


async def test_y_copies_the_numbers_of_the_page(monkeypatch: pytest.MonkeyPatch) -> None:
    """Plain text without plots and keys; what was copied is said, and in tmux what to allow."""
    monkeypatch.setenv("TMUX", "/tmp/tmux-0/default,1,0")
    app = _app(FakeClient())
    async with app.run_test(size=SMALLEST) as pilot:
        await shows(pilot, "SIMULATED")
        await pilot.press("y")
        await shows(pilot, "copied the Live page as text", "tmux set -g set-clipboard on")
        assert "0.3461" in app.clipboard
        assert "1000.981" in app.clipboard
        assert "q quit" not in app.clipboard
        await pilot.press("4", "y")
        await shows(pilot, "copied the Filter page")
        assert "±0.0291" in app.clipboard


async def test_a_picture_gets_a_name_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """SVG files beside the logs, or in the working folder; never over another file."""
    monkeypatch.chdir(tmp_path)
    client = FakeClient()
    client.changes["logs"] = str(tmp_path / "logs")
    async with _app(client).run_test(size=SMALLEST) as pilot:
        await shows(pilot, "SIMULATED")
        await pilot.press("P")
        await shows(pilot, "picture of the screen")
        await pilot.press("P")
        await until(pilot, lambda: len(list((tmp_path / "logs").glob("imutui_live_*.svg"))) == 2)
        client.changes["logs"] = "/proc/none"
        await pilot.press("3")
        await shows(pilot, "NOT RECORDING")
        polls = client.polls
        await until(pilot, lambda: client.polls > polls + 2)
        await pilot.press("P")
        await until(pilot, lambda: list(tmp_path.glob("imutui_record_*.svg")))


async def test_a_theme_of_the_configuration_takes_effect() -> None:
    """By its own name, or as light and dark; a name that is none is refused with those there are."""
    for asked, name in (("ansi-light", "ansi-light"), ("light", "textual-light"), ("dark", "textual-dark")):
        app = ImutuiApp(FakeClient(), look=Look(theme=asked))  # type: ignore[arg-type]
        async with app.run_test(size=SMALLEST) as pilot:
            await shows(pilot, "SIMULATED")
            assert app.theme == name
    with pytest.raises(ValueError, match=r'`screen.theme` is "sunset"; there are: dark, light.*ansi-dark'):
        Look(theme="sunset")


async def test_quitting_asks_about_jobs_that_would_be_lost() -> None:
    """Without an acquisition too; the job is named, Esc stays, s quits and ends it."""
    ended: list[str] = []
    app = ImutuiApp()
    async with app.run_test(size=SMALLEST) as pilot:
        await shows(pilot, "not connected")
        await pilot.press("6")
        page = app.page
        assert page is not None
        page.busy = lambda: ["tracing a.mcap"]  # type: ignore[method-assign]
        page.abandon = lambda: ended.append("ended")  # type: ignore[method-assign]
        await pilot.press("q")
        await shows(pilot, "tracing a.mcap: this ends with the screen, without a result")
        await pilot.press("escape", "q", "s")
        await until(pilot, lambda: app._exit)
    assert ended == ["ended"]


async def test_an_impossible_rate_is_said_while_typing_and_not_sent(machine: list[Plan]) -> None:
    """The range is named beside the field, and Enter refuses."""
    async with _app(None).run_test(size=SMALLEST) as pilot:
        await shows(pilot, "virtual, 133 Hz")
        await pilot.press("tab", "tab", "end", "4")
        await shows(pilot, "outside 0.1 to 133 Hz")
        await pilot.press("enter")
        await shows(pilot, "The rate is outside 0.1 to 133 Hz")
    assert machine == []


async def test_a_failed_start_shows_the_whole_reason(machine: list[Plan], monkeypatch: pytest.MonkeyPatch) -> None:
    """The paragraph stays with the form, what was asked for is in the form, and the exit code is the error's."""
    reason = "/dev/ttyUSB7 is not there. Ports of this machine: none. Plug the adapter in, then press Enter."

    def fail(plan: Plan) -> FakeClient:
        raise SessionError(reason, 4)

    monkeypatch.setattr(application.session, "start", fail)
    app = ImutuiApp(plan=Plan("/dev/ttyUSB7", 20.0))
    async with app.run_test(size=SMALLEST) as pilot:
        screen = await shows(pilot, "Could not connect.", "press Enter.")
        assert " ".join(screen.split()).find(reason) > 0
        assert "ttyUSB7, 20 Hz, stream" in screen
        await pilot.press("ctrl+q")
        await until(pilot, lambda: app._exit)
    assert app.return_value == 4


async def test_a_running_acquisition_is_offered_first(machine: list[Plan], monkeypatch: pytest.MonkeyPatch) -> None:
    """Enter looks at it again and starts nothing."""
    monkeypatch.setattr(application.session, "running", lambda: ["default"])
    monkeypatch.setattr(application.session, "attach", FakeClient)
    async with _app(None).run_test(size=SMALLEST) as pilot:
        await shows(pilot, 'running acquisition "default"')
        await pilot.press("enter")
        await shows(pilot, "gyro, deg/s")
    assert machine == []


async def test_the_connected_page_stops_only_after_asking() -> None:
    """Another instrument needs the first one stopped; a recording is finished, and named."""
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
