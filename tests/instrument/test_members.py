"""What every instrument of the registry owes, whatever its protocol."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from helpers.units import Still, served
from hypothesis import given, settings
from hypothesis import strategies as st

from filters import specification
from imutui.cli import virtual_units
from imutui.instrument import names
from imutui.instrument.counts import DataPacket
from imutui.instrument.driver import Driver
from imutui.instrument.frame_search import Discarded
from imutui.instrument.imu400 import unit as imu400_unit
from imutui.instrument.port import Port
from imutui.instrument.registry import INSTRUMENTS, is_known, of_model, which_answers
from imutui.instrument.uut import unit as uut_unit
from imutui.session.plan import Plan

UNITS: dict[str, Callable[[], Any]] = {
    "imu400cd": lambda: imu400_unit.VirtualUnit(Still()),
    "imu381": lambda: uut_unit.VirtualUnit(Still()),
}
every = pytest.mark.parametrize("name", sorted(INSTRUMENTS))


@dataclass
class Spoken:
    """What a unit sent within a second of streaming, as bytes, and the packets in them."""

    data: bytes
    packets: list[DataPacket]


def host_of(name: str, port: Any = None) -> Driver:
    return INSTRUMENTS[name](port, INSTRUMENTS[name].most_rate_hz)


def decoded(name: str, pieces: list[bytes]) -> list[DataPacket | Discarded]:
    stream = (host_of(name, _Named())).packets()
    events = [event for piece in pieces for event in stream.feed(piece)]
    return events + list(stream.quiet())


class _Named:
    """A port that is never written to."""

    name = "port"


_SPOKEN: dict[str, Spoken] = {}


def spoken(name: str) -> Spoken:
    """Bytes of a stream, read from a virtual unit over a pseudo-terminal, once in a run."""
    if name not in _SPOKEN:
        with served(UNITS[name]()) as path, Port(path, INSTRUMENTS[name].power_up_bauds[0]) as port:
            host = host_of(name, port)
            host.open(None)
            host.start()
            data = b""
            while len(data) < 25 * INSTRUMENTS[name].packet_bytes:
                data += port.read(256)
            host.leave()
        _SPOKEN[name] = Spoken(data, whole(decoded(name, [data])))
    return _SPOKEN[name]


def whole(events: list[DataPacket | Discarded]) -> list[DataPacket]:
    return [event for event in events if not isinstance(event, Discarded)]


def test_every_member_has_a_virtual_unit() -> None:
    assert set(UNITS) == set(INSTRUMENTS) == set(virtual_units.UNITS)
    assert tuple(INSTRUMENTS) == names.NAMES


@every
def test_a_model_is_of_one_instrument_and_has_a_specification(name: str) -> None:
    instrument = INSTRUMENTS[name]
    for model in (instrument.model, *instrument.models):
        assert of_model(f"{model.lower()}-200") is instrument
        assert is_known(model)
        assert specification.is_known(model)
    assert not is_known("MTi-30")


@every
@pytest.mark.parametrize("share", [0.01, 0.1, 0.37, 1.0])
def test_samples_are_packets_or_means_of_more(name: str, share: float) -> None:
    instrument = INSTRUMENTS[name]
    rate_hz = share * instrument.most_rate_hz
    assert rate_hz <= instrument.packets_hz(rate_hz) <= instrument.most_rate_hz
    assert all(instrument.packets_hz(own) == own for own in instrument.rates_hz)


@every
def test_a_virtual_unit_and_its_host_agree(name: str) -> None:
    found, instrument = spoken(name).packets, INSTRUMENTS[name]
    assert len(found) >= 20
    scaling = instrument.scaling(instrument.rate_range_dps, instrument.accel_range_g)
    rates = scaling.rates_dps([packet.rates for packet in found])
    assert np.allclose(rates, [0.1, -0.2, 0.3], atol=0.02)
    accels = scaling.accels_g([packet.accels for packet in found])
    assert np.allclose(np.abs(accels), [0.0, 0.0, 0.998], atol=1e-3)
    assert np.allclose(scaling.temperature_degc([p.temperature for p in found]), 25.0, atol=0.2)
    assert all(0 <= packet.ticks < 65536 for packet in found)
    assert all((packet.details is not None) is (instrument.status_names is not None) for packet in found)


@every
def test_each_tells_itself_from_the_others(name: str) -> None:
    with served(UNITS[name]()) as path, Port(path, INSTRUMENTS[name].power_up_bauds[0]) as port:
        assert which_answers(port).name == name
        identity = host_of(name, port).find()
    assert identity.serial_number == "9911750"
    assert identity.version.upper().startswith(INSTRUMENTS[name].model[:6])


def test_the_usual_unit_hears_no_question_at_another_speed() -> None:
    """What others are asked at their speeds it could take for commands: it is known before, while it streams too."""
    heard: list[str] = []
    unit = UNITS[names.DEFAULT]()
    with served(unit, log=heard.append) as path, Port(path, unit.baud) as port:
        for begin in (b"", b"cC"):
            port.write(begin)
            assert which_answers(port).name == names.DEFAULT
    assert "R: ping" in heard
    assert not [line for line in heard if "line noise" in line]


@every
def test_polled_packets_are_those_of_a_stream(name: str) -> None:
    with served(UNITS[name]()) as path, Port(path, INSTRUMENTS[name].power_up_bauds[0]) as port:
        host = INSTRUMENTS[name](port)
        host.open(None)
        poller = host.poller(lambda: False)
        answers = [answer for answer in (poller.poll() for _ in range(20)) if answer is not None][:5]
    assert len(answers) == 5
    assert all(answer.requested_ns < answer.arrived_ns for answer in answers)
    streamed = np.mean([packet.rates for packet in spoken(name).packets], axis=0)
    assert np.allclose([each.packet.rates for each in answers], streamed, atol=2)


@every
@settings(max_examples=25, deadline=None)
@given(cuts=st.lists(st.integers(0, 800), max_size=12))
def test_a_stream_means_the_same_however_it_is_cut(name: str, cuts: list[int]) -> None:
    data = spoken(name).data
    ends = sorted({0, len(data), *(min(cut, len(data)) for cut in cuts)})
    pieces = [data[a:b] for a, b in pairwise(ends)]
    assert whole(decoded(name, pieces)) == spoken(name).packets
    assert whole(decoded(name, [bytes([b]) for b in data])) == spoken(name).packets


@every
@settings(max_examples=100, deadline=None)
@given(pieces=st.lists(st.binary(max_size=120), max_size=6))
def test_no_bytes_raise_and_a_stream_behind_them_is_found(name: str, pieces: list[bytes]) -> None:
    """Whatever came before, the stream's last packets are read as they are."""
    last = spoken(name).packets[-8:]
    assert whole(decoded(name, [*pieces, spoken(name).data]))[-8:] == last


@every
def test_a_rate_that_there_is_not_is_refused_in_words(name: str) -> None:
    most = INSTRUMENTS[name].most_rate_hz
    with pytest.raises(ValueError, match=f"{most:g}"):
        Plan("/dev/none", instrument=name, rate_hz=most * 1.5)


@every
def test_a_unit_is_left_as_it_was_found(name: str) -> None:
    with served(UNITS[name]()) as path:
        seen = []
        for _ in range(2):
            with Port(path, INSTRUMENTS[name].power_up_bauds[0]) as port:
                port.discard_input()
                streams = bool(port.read(2 * INSTRUMENTS[name].packet_bytes))
                host = host_of(name, port)
                identity = host.open(None)
                host.start()
                port.read(INSTRUMENTS[name].packet_bytes)
                host.leave()
            seen.append((streams, identity.serial_number, identity.version))
    assert seen[0] == seen[1], json.dumps([str(each) for each in seen])


@every
@pytest.mark.parametrize("least", [True, False])
def test_counts_there_and_back(name: str, least: bool) -> None:
    instrument = INSTRUMENTS[name]
    scaling = instrument.scaling(instrument.rate_range_dps, instrument.accel_range_g)
    end = instrument.count_limits[0 if least else 1]
    counts = np.array([[end, end // 2], [1, 0]])
    for scaled in (scaling.rates_dps, scaling.accels_g):
        values = scaled(counts)
        assert values.shape == counts.shape
        assert np.array_equal(np.rint(values / values[1, 0]), counts)
