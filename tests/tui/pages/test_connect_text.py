"""What the connect page offers, as words."""

from helpers.fake_client import FakeClient
from helpers.shapes import whole

from filters.kalman.settings import FILTERS
from imutui.session.snapshot import ProbeAnswer
from imutui.settings import SETTINGS
from imutui.tui.formatting import StyledText
from imutui.tui.pages.connect import text


def _plain(parts: StyledText) -> str:
    return "".join(part if isinstance(part, str) else part[0] for part in parts)


def test_every_filter_and_sampling_is_offered() -> None:
    offered = {key: tuple(value for value, _ in each.setting.offers) for key, each in SETTINGS.items()}
    assert offered["filter.name"] == SETTINGS["filter.name"].allowed == (*FILTERS, "none")
    assert offered["acquisition.sampling"] == SETTINGS["acquisition.sampling"].allowed


def test_an_answer_stands_in_place_of_the_description() -> None:
    found = text.choices([], [("/dev/ttyUSB0", "FT232R"), ("/dev/ttyUSB1", "FT232R")])
    heard = {"/dev/ttyUSB0": "IMU400CD 1.2 #9911750"}
    labels = [text.label(choice, heard) for choice in found]
    assert labels[0].split() == ["ttyUSB0", "IMU400CD", "1.2", "#9911750"]
    assert labels[1].endswith("FT232R")
    assert labels[2].startswith("virtual instrument")


def test_what_a_probe_found_is_short() -> None:
    def answered(**fields: object) -> str:
        return text.answered(whole(ProbeAnswer, port="/dev/x", **fields))

    assert answered(answers=True, firmware="IMU400CD 1.2", serial_number="7") == "IMU400CD 1.2 #7"
    assert answered(answers=True) == "answers a ping"
    assert answered() == "silent"
    for error, short in (
        ("/dev/x is silent: no answer to a ping (tried 38400 baud). Check", "silent"),
        ("/dev/x is in use by picocom (pid 12). If that is imutui: stop it", "in use by picocom (pid 12)"),
        ("/dev/x: no permission to open it. It belongs to group dialout", "no permission to open it"),
    ):
        assert answered(error=error) == short
    other = {"answers": True, "firmware": "AHRS400", "serial_number": "7", "error": "/dev/x: another model"}
    assert answered(**other) == "AHRS400 #7, not usable"


def test_several_acquisitions_are_to_be_chosen_from() -> None:
    assert "choose one" in _plain(text.lead(text.choices(["a", "b"], [])))
    assert "choose" not in _plain(text.lead(text.choices(["a"], [])))


def test_a_batch_is_one_choice_and_its_units_are_none() -> None:
    found = text.choices(["lot:1", "lot:2", "single"], [])
    assert [(choice.kind, choice.value) for choice in found[:2]] == [("batch", "lot"), ("attach", "single")]
    assert "A batch is running. Enter looks" in _plain(text.lead(text.choices(["lot:1", "lot:2"], [])))


def test_what_is_connected_is_said_with_its_reference_file() -> None:
    now = FakeClient().snapshot()
    now = {**now, "reference": {"name": "profile", "file": "tumble.toml", "profile": True}, "effects": ["gy tone"]}
    said = _plain(text.connected(now))
    assert "from tumble.toml, with 1 effect found before" in said
    assert "r records them" in text.next_step(now)
