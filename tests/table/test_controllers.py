"""A controller commands a virtual table, over TCP and over a serial line."""

import math

import pytest
from helpers.tables import rests, served, wait_for

from filters.errors import InputError
from filters.simulation import TableFault, TableModel
from imutui.table.acutrol import connect
from imutui.table.links import TableError, TableLinkError
from imutui.table.motion import AxisLimits, Move, Swing, Turn
from imutui.table.server import BUS, TCP

every = pytest.mark.parametrize("prefix", [TCP, BUS], ids=["tcp", "serial line"])
STOPS = TableModel(seed=3, low=math.radians(-110.0), high=math.radians(110.0))


@every
def test_it_says_who_it_is_and_what_its_axes_may_do(prefix: bytes) -> None:
    with served(STOPS, prefix=prefix) as it:
        controller = it.connected()
        assert controller.axes == ("outer", "middle", "inner")
        assert "VIRTUAL SIM TABLE" in controller.identify()
        limited = AxisLimits(400.0, 500.0, -110.0, 110.0)
        endless = AxisLimits(400.0, 500.0, None, None)
        assert controller.limits() == {"outer": limited, "middle": limited, "inner": endless}
        assert not it.told


@pytest.mark.parametrize("count", [1, 2, 3])
def test_it_is_asked_how_many_axes_it_has(count: int) -> None:
    axes = ("outer", "middle", "inner")[-count:]
    with served(TableModel(axes=axes)) as it:
        assert it.connected().axes == axes


def test_axes_can_be_named_in_the_order_of_their_numbers() -> None:
    with served(TableModel(axes=("inner", "outer"))) as it:
        controller = connect(f"{it.url}?axes=inner,outer")
        controller.enable()
        controller.start(Move("inner", 5.0, 100.0, 400.0))
        state = wait_for(controller, lambda s: rests(s) and abs(s.angles_deg[2] - 5.0) < 0.01)
        assert math.remainder(state.angles_deg[0], 360.0) == pytest.approx(0.0, abs=0.05)
        assert it.table.axes["inner"].angle == pytest.approx(math.radians(5.0), abs=1e-3)


@every
def test_it_goes_where_it_is_told_and_no_faster(prefix: bytes) -> None:
    with served(prefix=prefix) as it:
        controller = it.connected()
        controller.enable()
        controller.start(Move("middle", 357.0, 60.0, 200.0))
        rates = []
        wait_for(
            controller,
            lambda s: rates.append(abs(s.rates_dps[1])) or (rests(s) and s.angles_deg[1] > 356.99),
        )
        assert max(rates) < 60.0 * 1.01
        assert controller.read().mode == "position"
        assert it.told[-4:] == [
            ":limit:rate pos,2,60", ":limit:acc pos,2,200", ":demand:position 2,357", ":mode:position 2",
        ]  # fmt: skip


@every
def test_a_rate_is_held_and_a_stop_ends_it(prefix: bytes) -> None:
    with served(prefix=prefix) as it:
        controller = it.connected()
        controller.enable()
        controller.start(Turn("inner", 90.0, 400.0))
        state = wait_for(controller, lambda s: abs(s.rates_dps[2] - 90.0) < 0.1)
        assert state.mode == "rate"
        controller.stop()
        assert wait_for(controller, lambda s: rests(s)).mode == "off"
        assert it.told[-9:-7] == [":demand:rate 3,0", ":mode:rate 3"]  # the fastest axis first
        assert sorted(it.told[-3:]) == [":mode:off 1", ":mode:off 2", ":mode:off 3"]


@every
def test_it_swings_about_where_it_is_until_the_amplitude_is_zero(prefix: bytes) -> None:
    with served(prefix=prefix) as it:
        controller = it.connected()
        controller.enable()
        controller.start(Swing("inner", 4.0, 1.0, 500.0))
        assert controller.read().mode == "oscillation"
        wait_for(controller, lambda s: 3.0 < s.angles_deg[2] < 5.0)
        wait_for(controller, lambda s: 3.0 < 360.0 - s.angles_deg[2] < 5.0)
        controller.start(Swing("inner", 0.0, 1.0, 500.0))
        wait_for(controller, lambda s: rests(s) and abs(math.remainder(s.angles_deg[2], 360.0)) < 0.02)


def test_a_stop_is_for_every_axis_whatever_its_mode_is_said_to_be() -> None:
    with served() as it:
        controller = it.connected()
        controller.stop()
        assert [told.split()[0] for told in it.told if "off" in told] == [":mode:off"] * 3
        controller.enable()
        controller.disable()
        assert it.told[-3:] == [f":interlock:open {n}" for n in (1, 2, 3)]


def test_a_stop_reaches_an_axis_that_is_on_its_way_to_a_position() -> None:
    with served() as it:
        controller = it.connected()
        controller.enable()
        controller.start(Move("inner", 170.0, 100.0, 400.0))
        wait_for(controller, lambda s: s.rates_dps[2] > 50.0)
        controller.stop()
        wait_for(controller, lambda s: rests(s))
        assert abs(it.table.axes["inner"].angle) < math.radians(120.0)


def test_of_an_axis_that_the_table_has_not_nothing_is_sent() -> None:
    with served(STOPS) as it:
        controller = it.connected()
        with pytest.raises(InputError, match="no up axis"):
            controller.start(Turn("up", 1.0, 100.0))
        assert not it.told


def test_a_stamp_is_half_way_between_question_and_answer() -> None:
    """A link that is slow by a known time says so in the uncertainty, which holds the true instant."""
    slow = TableFault(0.0, "slow", delay=0.03)
    with served(None, slow) as it:
        controller = it.connected()
        controller.enable()
        controller.start(Turn("inner", 100.0, 400.0))
        state = wait_for(controller, lambda s: s.rates_dps[2] > 99.9)
        assert state.uncertainty_ns >= 15_000_000
        later = controller.read()
        seconds = (later.stamp_ns - state.stamp_ns) * 1e-9
        allowed = 100.0 * (state.uncertainty_ns + later.uncertainty_ns) * 1e-9 + 0.05
        assert abs(math.remainder(later.angles_deg[2] - state.angles_deg[2] - 100.0 * seconds, 360.0)) <= allowed


# ------------------------------------------------------------------------------------------------------------- faults


def test_what_is_not_recognised_is_asked_once_more() -> None:
    with served(None, TableFault(0.0, "unrecognised", count=1)) as it:
        assert it.connected().axes == ("outer", "middle", "inner")
    with (
        served(None, TableFault(0.0, "unrecognised", count=2)) as it,
        pytest.raises(TableError, match=r'"Command not recognized" to ":read:position. 1", 2 times'),
    ):
        it.connected()


@every
def test_an_interlock_that_opens_is_a_fault_until_it_is_reset(prefix: bytes) -> None:
    with served(None, TableFault(0.0, "interlock"), prefix=prefix) as it:
        controller = it.connected()
        assert "outer axis's interlock says Fault" in controller.read().fault
        with pytest.raises(TableError, match=r"interlock says Fault|Interlock not closed"):
            controller.start(Turn("inner", 10.0, 100.0))
        controller.enable()
        assert controller.read().fault == ""


def test_an_end_switch_stops_its_axis_and_is_a_fault() -> None:
    with served(None, TableFault(0.7, "limit", axis="inner")) as it:
        controller = it.connected()
        controller.enable()
        controller.start(Turn("inner", 50.0, 500.0))
        state = wait_for(controller, lambda s: s.fault != "")
        assert state.fault == "the inner axis's interlock says Fault"
        wait_for(controller, lambda s: rests(s) and s.mode == "off")


def test_an_axis_that_is_stuck_stays_where_it_is() -> None:
    with served(None, TableFault(0.0, "stuck", axis="inner")) as it:
        controller = it.connected()
        controller.enable()
        controller.start(Move("inner", 10.0, 50.0, 400.0))
        until = it.server.known() + 0.5
        state = wait_for(controller, lambda s: it.server.known() > until)
        assert math.remainder(state.angles_deg[2], 360.0) == pytest.approx(0.0, abs=0.05)
        assert state.mode == "position"


def test_a_controller_that_falls_silent_is_a_lost_link_and_the_table_goes_on() -> None:
    with served(None, TableFault(1.0, "silent")) as it:
        controller = it.connected()
        controller.enable()
        controller.start(Turn("inner", 50.0, 500.0))
        with pytest.raises(TableLinkError, match="does not answer"):
            wait_for(controller, lambda s: False)
        it.server.known()
        assert it.table.axes["inner"].rate > 0.5


def test_a_cut_link_is_a_lost_link_and_another_connection_stops_the_table() -> None:
    with served(None, TableFault(1.0, "cut", seconds=0.5)) as it:
        controller = it.connected()
        controller.enable()
        controller.start(Turn("inner", 50.0, 500.0))
        with pytest.raises(TableLinkError, match="lost"):
            wait_for(controller, lambda s: False)
        controller.close()
        while it.server.known() < 1.6:
            pass
        assert it.table.axes["inner"].rate > 0.5
        again = it.connected()
        assert again.read().mode == "rate"
        again.stop()
        wait_for(again, lambda s: rests(s) and s.mode == "off" and it.table.axes["inner"].is_idle)


def test_several_hosts_are_served_at_once() -> None:
    with served() as it:
        one, other = it.connected(), it.connected()
        one.enable()
        one.start(Turn("inner", 20.0, 500.0))
        wait_for(other, lambda s: s.rates_dps[2] > 19.0)
        other.stop()
        assert one.read().mode == "off"
