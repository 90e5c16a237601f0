"""The Live page: one channel large, the others as numbers with a trend."""

from helpers.pilot import SMALLEST, opened

from imutui.tui.pages.live.channels import ChannelTable
from imutui.tui.widgets.plot import Plot

WIDE = (120, 40)


async def test_the_chosen_channel_is_large_and_others_have_numbers_and_a_trend() -> None:
    async with opened() as see:
        page = see.app.screen

        def shown() -> list[str]:
            return [str(plot.id) for plot in page.query(Plot) if plot.display]

        await see("→ >gx | gx, deg/s, with mean | K/min | channel")
        assert shown() == ["one"]
        assert page.query_one("#one", Plot).size.height >= 8
        await see("down down down → >ax | ax, mg, with mean")
        await see("up up up up → >T | T, °C, with mean")
        table = page.query_one(ChannelTable)
        await see.until(lambda: all(line[-1].strip() for line in table.render().plain.splitlines()[1:]))


async def test_a_tall_terminal_has_room_for_six_lanes() -> None:
    async with opened(size=WIDE) as see:
        await see("→ gyro, deg/s | accel, mg")
        await see.pilot.resize_terminal(*SMALLEST)
        await see("→ gx, deg/s, with mean")


async def test_what_a_unit_says_of_itself_stands_beside_what_was_lost() -> None:
    async with opened() as see:
        await see("→ bad checksums 0")
        assert "BIT" not in see.text()
        see.client.changes["status"] = "0x0002 (hardware error)"
        await see("→ bad checksums 0  BIT hardware error")
