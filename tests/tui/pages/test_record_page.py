"""The Record page at 80×24, and its words."""

from typing import Any

import pytest
from helpers.fake_client import PATH, FakeClient, acquisition
from helpers.pilot import opened

from imutui.session.plan import RecordingWish
from imutui.tui.pages.record import text

SNAPSHOT: dict[str, Any] = FakeClient().snapshot()


async def test_record_has_every_vital_text_at_80x24() -> None:
    async with opened(recording=True) as see:
        screen = await see(f"3 → ● RECORDING  0:1 | {PATH} | q quit")
        for text in (
            "123 kB", "grows 22.0 MB/h", "full in 98 days", "52.00 GB free", "part 1, one file", "flushed 0.4 s ago",
            "asked 20 Hz, measured 20.00 Hz", "133.31 packets/s", "lost 0, checksum errors 0, resynchronised 0 B",
            "line      ok", "operator  ana", "place     lab 2", "table id  AC-120", "new file every, min",
            "or every, MB",
            "note", "10:30:30   0:00:03  door closed", "e edit form", "r finish", "m mark", "? help", "q quit",
        ):  # fmt: skip
            assert text in screen, text


async def test_a_late_flush_is_said_in_words() -> None:
    client = acquisition(recording=True)
    take = client._recording(0.0)
    client.changes["recording"] = {**take, "flush_age_s": 4.24}
    async with opened(client) as see:
        await see("3 → LATE: last flush 4.2 s ago; the disk does not keep up")


async def test_the_form_goes_into_the_next_recording() -> None:
    async with opened() as see:
        await see("3 → NOT RECORDING | r begins a file | operator  ana")
        screen = await see(
            "e end ' r' tab tab tab '30' enter 'cold 1' → operator  ana r | note      cold 1 | esc done | Esc done"
        )
        assert "r record" not in screen
        await see("escape 2 r → ● REC")
        assert see.client.wish == RecordingWish("cold 1", "ana r", rotate_minutes=30.0)


async def test_what_was_emptied_in_the_form_is_empty_and_what_was_left_is_as_the_acquisition_has_it() -> None:
    async with opened(note="demo") as see:
        await see("3 → note      demo")
        await see("e tab*4 backspace*4 escape r → A note for this recording")
        await see("enter → ● REC")
        assert see.client.wish == RecordingWish(note="")


async def test_note_and_operator_of_the_file_that_is_written_are_changed() -> None:
    async with opened(note="cold") as see:
        await see("3 →")
        assert "n note" not in await see.shows("NOT RECORDING")
        await see("r → ● REC | n note")
        await see("n →")
        await see.shows("operator  ana", "both go into the file".capitalize())
        await see("end 'er' enter → written into imu400cd_9911750")
        assert see.client.asked == ["record", "describe colder None"]


async def test_a_key_that_comes_twice_finishes_one_recording() -> None:
    async with opened(recording=True) as see:
        see.client.changes["recording"] = see.client.snapshot()[
            "recording"
        ]  # what is on the screen is older than the end
        await see("3 r r → the file is finished")
        await see("r →")
        del see.client.changes["recording"]
        await see.shows("wrote     ", "15246 samples")
        assert see.client.asked == ["stop_recording"]


async def test_what_was_typed_for_the_next_recording_waits_for_it() -> None:
    async with opened(recording=True, note="cold") as see:
        await see("3 e end 'eve' escape n → Both go into the file")
        await see("end 'er' enter → written into imu400cd_9911750")
        await see("2 3 r → NOT RECORDING | operator  anaeve")
        await see("r → ● REC")
        assert see.client.wish == RecordingWish(operator="anaeve")


async def test_the_form_shows_the_note_of_the_next_recording_and_not_that_of_the_present_one() -> None:
    client = acquisition(recording=True)
    client.changes |= {"note": "cold", "next_note": "demo"}
    async with opened(client) as see:
        screen = await see("3 → the recording after this gets | note      demo")
        assert "note      cold" not in screen


async def test_a_rotation_that_is_no_number_is_refused_with_its_field() -> None:
    async with opened() as see:
        await see('3 e tab*3 \'often\' → "new file every, min" is "often", not a number')
        await see('escape r → not recorded: "new file every, min" is "often"')
        assert see.client.asked == []


async def test_a_finished_file_is_named_with_what_comes_next() -> None:
    async with opened(note="cold") as see:
        await see("r → ● REC")
        await see("r → finished")
        await see(f"3 → wrote     {PATH} | 15246 samples in | 6 Logs opens it | NOT RECORDING")


async def test_an_empty_acquisition_page_has_no_numbers() -> None:
    async with opened(None) as see:
        await see("3 → NOT CONNECTED | 1 connects to an instrument; there, v starts the demo")
        await see.until(lambda: see.app.focused is None)


@pytest.mark.parametrize(
    ("seconds", "said"), [(600.0, "10 min"), (5400.0, "1.5 h"), (359_000.0, "99.7 h"), (8_500_000.0, "98 days")]
)
def test_time_to_full_has_the_unit_of_its_size(seconds: float, said: str) -> None:
    assert text.until_full(seconds) == said


def test_what_is_not_known_yet_is_said() -> None:
    take = {"bytes_per_s": None, "to_full_s": None, "flush_age_s": None, "part": 1}
    assert text.growth(take) == "growth not known before 10 s"
    assert text.fill_words(take, None) == "free space unknown"
    assert text.flush(take) == ("wait", "not flushed yet")


def test_rotation_in_words() -> None:
    assert text.rotation(0.0, None) == "one file"
    assert text.rotation(30.0, 0.0) == "a new file every 30 min"
    assert text.rotation(30.0, 100.0) == "a new file every 30 min or 100 MB"


def test_losses_and_silence_have_levels() -> None:
    assert text.losses(SNAPSHOT)[0] == "none"
    assert text.losses({**SNAPSHOT, "lost_packets": 2, "lost_packets_max": 2})[0] == "wait"
    assert "check the cable" in text.losses({**SNAPSHOT, "bad_checksums": 1})[1]
    assert text.line({**SNAPSHOT, "silent_s": 9.0})[0] == "bad"


def test_a_wish_takes_decimal_commas_and_refuses_nonsense() -> None:
    entered = dict.fromkeys(text.FIELDS, "")
    assert text.wish({}) == RecordingWish()
    assert text.wish(entered) == RecordingWish("", "", "", "", 0.0, 0.0)
    assert text.wish({**entered, "rotate_minutes": "2,5"}).rotate_minutes == 2.5
    assert text.wish(entered).rotate_mb == 0.0
    with pytest.raises(ValueError, match="or every, MB"):
        text.wish({**entered, "rotate_mb": "-1"})


def test_little_room_has_a_level() -> None:
    times = {None: "none", 3600.0: "none", 1700.0: "wait", 200.0: "bad"}
    assert {left: text.room({"to_full_s": left}) for left in times} == times
