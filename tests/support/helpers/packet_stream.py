"""A stream of packets with its truth: when each was sampled and sent, and what a host that is held up sees of it."""

from dataclasses import dataclass, field

import numpy as np

from imutui.instrument.clock import Clock, Gap, Stamp
from imutui.instrument.counter_spec import SPAN

LOOP_S = 7.5e-3
TICK_S = 0.79e-6
_READ_TIMEOUT_S = 0.05
_NS = 1e9


@dataclass(slots=True)
class Stream:
    """Packets of a unit, and how they reach the host; times in s of the host's clock."""

    # sampled, due: when each packet was sampled, and when its last byte has left the unit, shape (N,)
    sampled: np.ndarray
    ticks: np.ndarray
    due: np.ndarray
    arrives: np.ndarray  # when its last byte is in the host's buffer
    got: np.ndarray  # whether it does arrive
    cut: np.ndarray  # whether bytes that mean nothing come before it
    stalls: list[tuple[float, float]] = field(default_factory=list)  # from when to when the host does not read

    def lose(self, first: int, count: int = 1, *, cut: bool = False) -> None:
        """Let packets be lost on the line; `cut`: a piece of them arrives."""
        self.got[first : first + count] = False
        self.cut[first + count] |= cut

    def hold_line(self, start: float, seconds: float) -> None:
        """Let the line keep what would arrive meanwhile, and deliver it all at its end."""
        late = (self.arrives >= start) & (self.arrives < start + seconds)
        self.arrives[late] = start + seconds
        self.arrives = np.maximum.accumulate(self.arrives)

    def pause(self, first: int, seconds: float) -> None:
        """Let the unit send nothing for so long before a packet, its counter running on."""
        for times in (self.sampled, self.due, self.arrives):
            times[first:] += seconds
        self.ticks[first:] = (self.ticks[first:] - round(seconds / TICK_S)) % SPAN

    def bursts(self, period_s: float) -> None:
        self.arrives = np.ceil(self.arrives / period_s) * period_s


def stream(
    seconds: float,
    seed: int = 0,
    *,
    baud: int = 38400,
    skew_ppm: float = 0.0,
    late_s: float = 0.1e-3,
    loop_s: float = LOOP_S,
) -> Stream:
    """A unit that streams over a line of that speed; arrivals are late by the absolute of a normal of `late_s`."""
    rng = np.random.default_rng(seed)
    line = 180.0 / baud
    taken, free, sample = [], 0.0, -1
    while free < seconds:
        sample = max(sample + 1, int((free + 1e-9) / loop_s))
        free = max(sample * loop_s, free) + line
        taken.append((sample * loop_s, free))
    own = np.array(taken)
    start, scale = 1000.0 + rng.random(), 1.0 + skew_ppm * 1e-6
    sampled, due = start + scale * own[:, 0], start + scale * own[:, 1]
    # a line that sets the pace sends a sample that has waited: its counter is of when it was sampled
    ticks = (int(rng.integers(SPAN)) - np.floor(own[:, 0] / TICK_S).astype(np.int64)) % SPAN
    arrives = np.maximum.accumulate(due + np.abs(rng.normal(size=due.size)) * late_s)
    n = due.size
    return Stream(sampled, ticks, due, arrives, np.ones(n, bool), np.zeros(n, bool))


@dataclass(frozen=True, slots=True)
class Heard:
    """What a clock made of a stream."""

    stamps: list[Stamp]  # one a packet that arrived
    # error_s, uncertainty_s: stamp less truth, and how far off it says it may be
    error_s: np.ndarray
    uncertainty_s: np.ndarray
    lost_between: np.ndarray  # packets truly missing before each
    arrival_s: np.ndarray  # when each was read

    @property
    def lost(self) -> int:
        """Packets told as certainly lost."""
        return sum(gap.lost_min for gap in self.gaps)

    @property
    def gaps(self) -> list[Gap]:
        return [stamp.gap for stamp in self.stamps if stamp.gap is not None]


def hear(made: Stream, clock: Clock) -> Heard:
    """Read a stream as the reader thread does, packet by packet, and stamp it."""
    stamps: list[Stamp] = []
    reads: list[float] = []
    indices = np.flatnonzero(made.got)
    previous, ready = -1, float(made.arrives[0])
    following = [*made.arrives[indices[1:]].tolist(), np.inf]
    for i, next_arrives in zip(indices.tolist(), following, strict=True):
        cut = bool(made.cut[previous + 1 : i + 1].any())
        waits_from, at = ready, max(float(made.arrives[i]), ready)
        for start, end in made.stalls:
            if start <= at < end:
                waits_from = at = end
        stamps += clock.take(
            int(made.ticks[i]),
            round(at * _NS),
            contiguous=not cut,
            quiet=at - waits_from > _READ_TIMEOUT_S,
            behind=next_arrives <= at,
        )
        reads.append(at)
        previous, ready = i, at
    stamps += clock.release()
    error = np.array([stamp.monotonic_ns / _NS for stamp in stamps]) - made.sampled[indices]
    uncertainty = np.array([stamp.uncertainty_ns for stamp in stamps]) / _NS
    return Heard(stamps, error, uncertainty, np.diff(indices, prepend=-1) - 1, np.array(reads))
