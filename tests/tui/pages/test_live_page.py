"""The Live page: one channel large, the others as numbers with a trend."""

from helpers.fake_client import FakeClient
from helpers.pilot import SMALLEST, shows, text_of, until

from imutui.tui.app import ImutuiApp
from imutui.tui.pages.live.channels import ChannelTable
from imutui.tui.widgets.plot import Plot

WIDE = (120, 40)


async def test_the_chosen_channel_is_large_and_others_have_numbers_and_a_trend() -> None:
    async with ImutuiApp(FakeClient()).run_test(size=SMALLEST) as pilot:  # type: ignore[arg-type]
        page = pilot.app.screen

        def shown() -> list[str]:
            return [str(plot.id) for plot in page.query(Plot) if plot.display]

        await shows(pilot, ">gx", "gx, deg/s, with mean", "K/min", "channel")
        assert shown() == ["one"]
        assert page.query_one("#one", Plot).size.height >= 8
        await pilot.press("down", "down", "down")
        await shows(pilot, ">ax", "ax, mg, with mean")
        await pilot.press("up", "up", "up", "up")
        await shows(pilot, ">T", "T, °C, with mean")
        table = page.query_one(ChannelTable)
        await until(pilot, lambda: all(line[-1].strip() for line in table.render().plain.splitlines()[1:]))


async def test_a_tall_terminal_has_room_for_six_lanes() -> None:
    async with ImutuiApp(FakeClient()).run_test(size=WIDE) as pilot:  # type: ignore[arg-type]
        await shows(pilot, "gyro, deg/s", "accel, mg")
        await pilot.resize_terminal(*SMALLEST)
        await shows(pilot, "gx, deg/s, with mean")


async def test_what_a_unit_says_of_itself_stands_beside_what_was_lost() -> None:
    client = FakeClient()
    async with ImutuiApp(client).run_test(size=SMALLEST) as pilot:  # type: ignore[arg-type]
        await shows(pilot, "bad sums 0")
        assert "BIT" not in text_of(pilot.app)
        client.changes["status"] = "0x0002 (hardware error)"
        await shows(pilot, "bad sums 0  BIT 0x0002 (hardware error)")
