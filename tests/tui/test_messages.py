"""States said in words."""

import pytest
from helpers.fake_client import FakeClient
from helpers.shapes import whole

from imutui.logbook.results import ResultDocument
from imutui.session.client import SessionError
from imutui.session.plan import of_model
from imutui.tui import messages
from imutui.tui.pages.connect import text
from imutui.tui.pages.connect.text import Choice
from imutui.tui.pages.live.page import first_span


def test_silence_is_judged_by_the_packet_rate() -> None:
    """Ten seconds are silence for a stream, and normal for one poll in ten seconds."""
    silent = {**FakeClient().snapshot(), "silent_s": 10.0, "rate_hz": 0.1}
    assert "NO DATA for 10.0 s: check power and cable." in str(messages.silence(silent))
    assert messages.silence({**silent, "sampling": "polled"}) is None
    assert messages.silence({**silent, "sampling": "polled", "silent_s": 31.0}) is not None


def test_who_begins_a_file_is_told_of_the_profile_that_the_filter_goes_by() -> None:
    told = [
        messages.recording_to("/logs/x.mcap", None if reference is None else {"reference": reference})
        for reference in (
            None,
            {"name": "level", "file": "", "profile": False},
            {"name": "profile", "file": "tumble.toml", "profile": True},
        )
    ]
    assert told[:2] == ["recording to /logs/x.mcap"] * 2
    assert told[2] == "recording to /logs/x.mcap; reference: profile tumble, 5 Table guides"


def test_a_finished_file_is_named_with_its_biases() -> None:
    final = {"gyro_bias_dps": [0.1, None, -0.2], "accel_bias_mg": [1.0, 2.0, 3.0]}
    said = messages.finished(whole(ResultDocument, log="/logs/x.mcap", samples=246, final=final))
    assert said == (
        "finished /logs/x.mcap, 246 samples\ngyro bias 0.1000 – -0.2000 deg/s, accel bias 1.00 2.00 3.00 mg"
    )


def test_an_acquisition_that_does_not_answer_may_still_run() -> None:
    """A timeout is not called an end; what the acquisition itself says is passed on."""
    assert "`imutui status` tells" in messages.fault(TimeoutError("timed out"))
    assert messages.fault(SessionError("no space left")) == "no space left"


@pytest.mark.parametrize(("entered", "rate"), [("133", 133.0), ("0.1", 0.1), (" 0,5 ", 0.5)])
def test_rates_are_read(entered: str, rate: float) -> None:
    assert text.parse_rate(entered, of_model("")) == rate


@pytest.mark.parametrize("entered", ["", "fast", "0.05", "134", "nan"])
def test_impossible_rates_are_refused(entered: str) -> None:
    with pytest.raises(ValueError, match=r"0\.1 to 133 Hz"):
        text.parse_rate(entered, of_model(""))


def test_enter_takes_what_is_most_likely_meant() -> None:
    adapter, built_in = ("/dev/serial/by-id/usb-x", "ttyUSB0"), ("/dev/ttyS0", "n/a")
    assert text.likely(text.choices(["default"], [adapter])) == Choice(
        "attach", "default", 'running acquisition "default": look at it again'
    )
    assert text.likely(text.choices([], [built_in, adapter])).value == adapter[0]
    assert text.likely(text.choices([], [built_in])).value == "virtual"


@pytest.mark.parametrize(("rate", "span"), [(133.0, 30.0), (1.0, 60.0), (0.1, 600.0)])
def test_slow_packets_begin_with_a_long_span(rate: float, span: float) -> None:
    assert first_span(rate) == span
