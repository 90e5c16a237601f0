"""Status words of packets: each told once, the newest shown, and nothing of units whose packets have none."""

from imutui.instrument.imu400.crossbow import Mode, Packet
from imutui.instrument.registry import INSTRUMENTS
from imutui.instrument.uut.messages import PacketS1
from imutui.logbook.session_info import SessionInfo
from imutui.session.watches import Moment, StatusWords

NOW = Moment(0.0, False, None, SessionInfo(), None)


def packet(word: int) -> PacketS1:
    """A packet of an IMU381 with a status word."""
    return PacketS1((0, 0, 0), (0, 0, 0), (0, 0, 0), 0, 0, word)


def test_a_word_is_told_when_it_is_new_and_shown_while_it_is_the_newest() -> None:
    words = StatusWords(INSTRUMENTS["imu381"])
    for word in (0, 0x1000, 0, 0x1000, 0x0021):
        words.take(packet(word))
    assert [text.partition(";")[0] for text, _ in words.news(NOW)] == [
        "the unit's status word (BIT) is 0x1000 (sensor status)",
        "the unit's status word (BIT) is 0x0021 (master fail, reserved 5)",
    ]
    assert words.newest == "0x0021 (master fail, reserved 5)"
    assert list(words.news(NOW)) == []
    words.take(packet(0))
    assert words.newest == ""
    for word in range(1000):
        words.take(packet(word))
    assert len(list(words.news(NOW))) < 20


def test_packets_without_a_status_word_say_nothing() -> None:
    words = StatusWords(INSTRUMENTS["imu400cd"])
    words.take(Packet(Mode.SCALED, (0, 0, 0), (0, 0, 5461), 1550, 0))  # type: ignore[arg-type]
    assert (words.newest, list(words.news(NOW))) == ("", [])
