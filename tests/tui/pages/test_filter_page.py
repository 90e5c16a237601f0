"""The Filter page in a terminal: complete at 80×24, more with more room, and what its keys do."""

from typing import Any

import numpy as np
import pytest
from helpers.fake_client import PATH, FakeClient, acquisition, bias, estimates
from helpers.pilot import See, opened

from imutui.estimates import live_biases
from imutui.session.live_filter import RunHistory
from imutui.session.snapshot import Snapshot
from imutui.tui.connection.model import ConnectionModel

FOOTER = "enter plot t trace e effects space freeze w why r finish m mark"


async def filter_page(see: See, *texts: str) -> str:
    await see("4 →")
    return await see.shows("4 Filter", "bias", *texts)


def client_with(**changes: Any) -> FakeClient:
    """An acquisition whose filter is as a test wants it."""
    return acquisition(filter=estimates(**changes))


def lines_of(screen: str) -> list[str]:
    """Lines of the screen, all as wide as it."""
    return screen.splitlines()


async def test_every_vital_text_is_there_at_80x24() -> None:
    client = client_with()
    client.recording = True
    async with opened(client) as see:
        screen = await filter_page(see, "▲ AMBER", "z gyro: 3 sd 0.2100 deg/s, needs 0.15", FOOTER)
        for text in (
            ">x gyro     0.3461 ±0.0291  deg/s ▕·····│██···▏ ±1   +0.0004", "-6.11   ±0.67    mg", "9.8 s", "not yet",
            "NIS         0.24 of 9  no test: exact reference", "first 0.00",
            "unexplained gz 10 s means 2.1 × what noise allows", "t traces this recording", "velocity N", "m/s",
            "roll   0.002 ±0.017  deg", "lat -23.211323° ±0.4 m", "641.20", "reference level", "± is 3 sd", "w why",
            "─> x gyro, deg/s", "↑↓ choose, Enter enlarges",
        ):  # fmt: skip
            assert text in screen, text
        assert len(lines_of(screen)) == 24


async def test_the_header_has_the_badge_on_every_page() -> None:
    async with opened(filter=estimates()) as see:
        for key in "236":
            await see("→ SIMULATED")
            await see(f"{key} → filter ▲ AMBER 5 of 6")


async def test_alarms_are_in_full_behind_a_key() -> None:
    async with opened(filter=estimates(alarms=[f"alarm number {i}" for i in range(9)])) as see:
        await filter_page(see, "× RED", "9 alarms: alarm number 0", "! alarm number 1", "w: more")
        await see("w → BAD   alarms | wait  converged")
        await see("j*20 → alarm number 8")
        await see("escape →")
        await see.shows(FOOTER.replace("finish", "record"))


async def test_a_bias_is_chosen_and_its_plot_enlarged() -> None:
    async with opened(filter=estimates()) as see:
        await filter_page(see, "─> x gyro, deg/s")
        await see("down j down → >x accel | ─> x accel, mg")
        screen = await see("enter → Esc back, a scale")
        assert "velocity" not in screen
        assert "y gyro" not in screen
        await see("a a → scale: limits | +12 ┤ | -12 ┤")
        await see("up k k k → ─> z accel, mg")
        await see("escape → velocity N | >z accel")


async def test_without_a_filter_no_unit_has_the_limits_of_another() -> None:
    """Estimates of before are shown; what a data sheet allows is not known, so neither its lines nor its scale are."""
    client = FakeClient()
    client.changes.update(filter=None, instrument="IMU440CA-200")
    client.past = RunHistory()
    for k in range(0, 600, 2):
        client.past.estimates.add(float(k), np.full(6, 0.3), np.full(6, 0.1))
    async with opened(client) as see:
        screen = await see("4 enter a a → ─> x gyro | no limits known | 0.45 ┤")
        assert "+1 ┤" not in screen
        assert "Table 1" not in screen


async def test_the_enlarged_plot_has_pauses_and_temperature_of_the_whole_run() -> None:
    client = client_with()
    async with opened(client) as see:
        await filter_page(see, "─> x gyro, deg/s")
        await see("enter →")
        assert "temperature, °C" not in await see.shows("Esc back, a scale")
    client.past = RunHistory()
    for k in range(0, 1500, 2):
        if not 600 < k < 800:
            client.past.estimates.add(float(k), np.full(6, 0.3), np.full(6, 0.1))
        client.past.add_temperature(np.array([float(k)]), np.array([24.0 + 0.001 * k]))
    async with opened(client) as see:
        await filter_page(see, "─> x gyro, deg/s")
        await see("enter →")
        await see.shows("temperature, °C", " gap ", "25 min", "± 3 sd shaded")


@pytest.mark.parametrize("size", [(80, 40), (120, 40), (112, 34)])
async def test_a_tall_terminal_shows_all_six_plots(size: tuple[int, int]) -> None:
    client = client_with()
    async with opened(client) as see:
        small = lines_of(await filter_page(see, "▲ AMBER", "velocity N"))
    async with opened(client, size=size) as see:
        await filter_page(see, "▲ AMBER", "velocity N")
        names = [f"{axis} {kind}, {unit}" for axis in "xyz" for kind, unit in (("gyro", "deg/s"), ("accel", "mg"))]
        large = lines_of(await see.shows(*names))
        assert [line[:78].rstrip() for line in large[4:11]] == [line[:78].rstrip() for line in small[4:11]]
        assert ("why ▲ AMBER" in "\n".join(large)) == (size[0] >= 112)


async def test_t_and_e_say_where_that_is() -> None:
    async with opened(filter=estimates()) as see:
        await filter_page(see, "r records, then t traces")
        await see("t → not recording: r starts a recording, then t traces it")


async def test_what_is_wanted_is_done_on_the_logs_page() -> None:
    client = client_with()
    client.recording = True
    async with opened(client) as see:
        await filter_page(see, "t traces this recording")
        await see("t →")
        await see.until(lambda: see.app.current_mode == "logs")
        await see(f"→ trace of {PATH.rsplit('/', 1)[1][:20]}")
        await see("4 →")
        await filter_page(see, "t traces this recording")
        await see("e → 6 Logs | Load effects into the live filter")


async def test_loaded_effects_are_listed() -> None:
    effects = [
        {"name": "gz thermal_lin k (deg/s/K)", "value": 0.01234, "sd": 0.0004},
        {"name": "ax scale k", "value": -0.00213, "sd": 0.0003},
        {"name": "gy thermal_poly k2 (deg/s/K)", "value": 0.5, "sd": 0.1},
    ]
    async with opened(filter=estimates(effects=effects)) as see:
        screen = await filter_page(see, "effects", "gz: bias follows temperature 0.0123 ±0.0012 deg/s/K")
        assert "more" in screen
        await see("w →")
        await see("j*12 → LOADED EFFECTS | ax: scale factor is off -0.00213 ±0.00090")
        await see("→ gy: bias is a curve in temperature, quadratic term 0.50 ±0.30 deg/s/K")


async def test_what_is_unobservable_says_so() -> None:
    biases = live_biases(estimates())
    for i, name in ((3, "x accel"), (4, "y accel")):
        biases[i] = bias(name, None, None, observable=False, converged_s=None, change_10s=None)
    async with opened(filter=estimates(biases=biases, reference="gravity")) as see:
        screen = await filter_page(see, "unobservable", "3 of 4 observable biases converged")
        assert len(lines_of(screen)) == 24
        await see("down down down → unobservable in this setup")


async def test_a_frozen_channel_has_no_uncertainty_and_is_named_as_frozen() -> None:
    biases = live_biases(estimates())
    biases[1] = bias("y gyro", None, None, observable=False, converged_s=None, change_10s=0.25)
    fault = {"channel": "gy", "kind": "frozen", "since_s": 5.0, "level": "bad", "said": "gy is frozen at 1 deg/s"}
    async with opened(filter=estimates(biases=biases), health=[fault]) as see:
        screen = await filter_page(see, "× RED   gy is frozen at 1 deg/s")
        (row,) = [line for line in lines_of(screen) if line.startswith(" y gyro")]
        assert row.split()[:3] == ["y", "gyro", "–"]
        assert row.endswith("gy is frozen")
        assert "±–" not in row
        assert "0.25" not in row
        await see("down → gy is frozen: there is no estimate")
        assert "unobservable" not in see.text()


async def test_frozen_numbers_do_not_hide_a_red_badge() -> None:
    async with opened(filter=estimates()) as see:
        await filter_page(see, "▲ AMBER")
        await see("space → FROZEN")
        see.client.changes["filter"] = estimates(failure="the filter stopped, recording goes on: sample 7")
        await see("→ filter × RED stopped | (frozen; now × RED) | 5 of 6 biases converged")
        await see("space → × RED   the filter stopped")


@pytest.mark.parametrize("glyphs", ["block", "ascii"])
async def test_poor_fonts_lose_nothing(glyphs: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("IMUTUI_SCREEN_GLYPHS", glyphs)
    biases = [bias(name, -0.4702, 0.0291, observable=name[0] != "y") for name in ("x gyro", "y gyro", "z gyro")]
    biases += live_biases(estimates())[3:]
    async with opened(filter=estimates(biases=biases, rejected=812)) as see:
        screen = await filter_page(see, "unobservable", "gates 812", "velocity N", "1.1 m")
        table = lines_of(screen)[4:11]
        assert [line[1:8].strip() for line in table] == [
            "bias",
            *[f"{a} {k}" for k in ("gyro", "accel") for a in "xyz"],
        ]
        assert screen.isascii() or glyphs == "block"
        assert not any("\u2800" < sign < "\u2900" for sign in screen)


async def test_no_color_loses_no_state(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NO_COLOR", "1")
    async with opened(filter=estimates(alarms=["innovations too large"])) as see:
        await filter_page(see, "× RED", "alarm: innovations too large", "filter × RED alarm")


async def test_no_filter_and_no_acquisition_say_what_to_do() -> None:
    client = acquisition(filter=None)
    async with opened(client) as see:
        await filter_page(see, "– OFF", "no filter in this acquisition", "1 Connect starts one with a filter")
    async with opened(None) as see:
        await see("4 →")
        await see.until(lambda: "no acquisition: 1 connects to one" in see.text())


def snapshot(t: float | None, since_start: float, **changes: Any) -> Snapshot:
    """What the link takes."""
    return {
        **FakeClient().snapshot(),
        "since_start_s": since_start,
        "filter": estimates(duration_s=t or 0.0, samples=0 if t is None else 246, **changes),
    }


def test_the_link_holds_the_badge_by_the_acquisitions_clock() -> None:
    link = ConnectionModel()
    converged = [bias(f"{axis} {kind}", 0.1, 0.02) for kind in ("gyro", "accel") for axis in "xyz"]
    good: dict[str, Any] = {"biases": converged, "remainder": [], "temperature_k_per_min": None}
    words = []
    for since, alarms in ((0.0, []), (3.0, ["x"]), (4.0, []), (4.9, []), (5.1, [])):
        link.take(snapshot(since + 1.0, since, alarms=alarms, **good))
        found = link.view().verdict
        assert found is not None
        words.append(found.word)
    assert words == ["AMBER", "RED", "RED", "RED", "AMBER"]
