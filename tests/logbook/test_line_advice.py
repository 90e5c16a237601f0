import os
import tty
from pathlib import Path

import pytest

from imutui.logbook import line_advice
from imutui.logbook.line_advice import LossAdvice


@pytest.mark.parametrize(
    ("port", "firmware", "kind"),
    [
        ("/dev/ttyUSB0", "IMU400CD-200 1.07", "cable"),
        ("/dev/serial/by-id/usb-FTDI_FT232R_A9-if00-port0", "", "cable"),
        ("socket://10.0.0.7:4001", "IMU400CD-200 1.07", "network"),
        ("/dev/pts/7", "IMU400CD-200 1.07", "pseudo-terminal"),
        ("/tmp/unit", "IMU400CD-200 VIRTUAL 1.0", "pseudo-terminal"),
    ],
)
def test_what_the_line_is_shows_in_the_port_and_in_what_the_unit_says(port: str, firmware: str, kind: str) -> None:
    assert line_advice.kind(port, firmware) == kind
    for said in (
        line_advice.of_losses(port, firmware, held_up=False),
        line_advice.of_silence(port, firmware),
        LossAdvice(port, firmware).brief,
    ):
        assert ("heck the cable" in said or "power and cable" in said) == (kind == "cable")


def test_a_link_to_a_pseudo_terminal_is_one(tmp_path: Path) -> None:
    master, slave = os.openpty()
    tty.setraw(slave)
    link = tmp_path / "unit"
    link.symlink_to(os.ttyname(slave))
    assert line_advice.kind(str(link), "") == "pseudo-terminal"
    os.close(master)
    os.close(slave)


def test_a_computer_that_read_late_where_packets_are_lost_is_named() -> None:
    """What waited before the overrun was late, what came behind it was not; losses at other times are the line's."""
    advice = LossAdvice("/dev/ttyUSB0", "")
    for lost, read_s, late_s in ((0, 1.0, 0.001), (0, 2.7, 1.7), (0, 2.7, 0.1), (120, 2.71, 0.002), (1, 9.0, 0.002)):
        advice.packet(lost, read_s, late_s)
    assert "too busy" in advice.brief
    advice = LossAdvice("/dev/ttyUSB0", "")
    for lost, read_s, late_s in ((0, 1.0, 0.001), (0, 2.7, 1.7), (0, 2.71, 0.002), (1, 9.0, 0.002)):
        advice.packet(lost, read_s, late_s)
    assert advice.brief == "check the cable"
