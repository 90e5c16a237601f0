"""Packets that the decoders find on spoiled lines, and false packets, which were never sent.

    python benchmarks/spoiled_lines.py [--shares 0.02 0.1 0.3 0.5] [--streams 10] [--packets 4000] [--seed 1]

Streams of units at rest, with a share of the packets spoiled: bits turned, bytes lost or put in, packets lost
whole. They are decoded in pieces of 37 bytes. "Whole" are the packets that reach the host undamaged, "us a packet" is
the processor time that one takes.
"""

import time
from collections import Counter
from collections.abc import Callable
from typing import Any

import bench
import numpy as np

from imutui.instrument.counter_spec import SPAN
from imutui.instrument.frame_search import Discarded
from imutui.instrument.imu400 import crossbow
from imutui.instrument.imu400.decoder import NOMINAL_PERIOD_S, packet_decoder
from imutui.instrument.uut import messages
from imutui.instrument.uut.decoder import Decoder

_PIECE_BYTES = 37


def imu400(k: int, words: list[int]) -> bytes:
    """A packet of an IMU400CD, its words near zero and hence full of 0xFF, as its headers are."""
    ticks = int(40000 - k * NOMINAL_PERIOD_S / crossbow.TICK_S) % SPAN
    a, b, c, d, e, f = words
    return crossbow.encode(crossbow.Packet(crossbow.Mode.SCALED, (a, b, c), (d, e, f), 1587, ticks))


def imu381(k: int, words: list[int]) -> bytes:
    a, b, c, d, e, f = words
    return messages.encode(messages.PacketS1((a, b, c), (d, e, f), (10219,) * 3, 10231, int(655.36 * k) % SPAN, 2))


UNITS: dict[str, tuple[Callable[[int, list[int]], bytes], Callable[[], Any]]] = {
    "imu400cd": (imu400, lambda: packet_decoder(crossbow.Mode.SCALED, streaming=True)),
    "imu381": (imu381, Decoder),
}


def spoiled(packet: bytes, rng: np.random.Generator) -> bytes:
    """The packet as a bad line hands it on; empty if it is lost."""
    data, at = bytearray(packet), int(rng.integers(len(packet)))
    match int(rng.integers(5)):
        case 0:
            data[at] ^= 1 << int(rng.integers(8))
        case 1:
            del data[at]
        case 2:
            del data[at : at + int(rng.integers(1, len(packet)))]
        case 3:
            data[at:at] = rng.bytes(int(rng.integers(1, 40)))
        case _:
            data.clear()
    return bytes(data)


def once(name: str, share: float, count: int, seed: int) -> np.ndarray:
    """Packets that were whole, of these found, false ones, and the seconds that the decoder took."""
    make, decoder_of = UNITS[name]
    rng = np.random.default_rng(seed)
    words = rng.normal(0.0, 20.0, (count, 6)).round().astype(int).tolist()
    line, whole = b"", Counter[bytes]()
    for k in range(count):
        packet = make(k, words[k])
        arrives = packet if rng.random() >= share else spoiled(packet, rng)
        line += arrives
        whole[packet] += packet in arrives
    decoder, found, began = decoder_of(), [], time.process_time()
    for at in range(0, len(line), _PIECE_BYTES):
        found += decoder.feed(line[at : at + _PIECE_BYTES])
    found += decoder.quiet()
    took = time.process_time() - began
    encode = crossbow.encode if name == "imu400cd" else messages.encode
    got = Counter(encode(event) for event in found if not isinstance(event, Discarded))
    return np.array([whole.total(), (got & whole).total(), (got - whole).total(), took])


def main() -> None:
    asked = bench.options(__doc__, shares=[0.02, 0.1, 0.3, 0.5], streams=10, packets=4000, seed=1)
    print(bench.describe("numpy"), flush=True)
    bench.head("unit", "spoiled", "whole", "found", "false", "us a packet")
    for name in UNITS:
        for share in asked.shares:
            made = [once(name, share, asked.packets, asked.seed + k) for k in range(asked.streams)]
            whole, found, false, took = np.sum(made, axis=0)
            us = f"{1e6 * took / (asked.packets * asked.streams):.1f}"
            bench.row(name, f"{100 * share:g} %", int(whole), int(found), int(false), us)


if __name__ == "__main__":
    main()
