"""The health of a unit's channels: one pass over its readings, in blocks that do not depend on how they arrive."""

import copy
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from filters.channels import CHANNELS, DPS, MG
from filters.effects import faults, quantisation
from filters.effects.fault_records import DataFault
from filters.health import finding
from filters.health.copies import SPAN, Copies
from filters.health.finding import HealthFinding, of_kind
from filters.health.levels import Levels
from filters.health.standstill import BLOCK, Standstill
from filters.health.values import Temperatures, Zeros
from filters.specification import ImuSpec
from filters.types import Array

_WINDOW = 4096  # readings that are searched for single faults at once
_LOOK_S = 20.0  # between two searches of readings that still come
_FEWEST = 256
_TEMPERATURE = 6
_UNITS = (DPS,) * 3 + (MG,) * 3
_NAMES = ("deg/s",) * 3 + ("mg",) * 3

# a kind of unit's noise differs by less than this from its data sheet, or from that of its other axes
# by slow and by fast differences; a low-pass filter leaves less of the fast ones
_NOISY, _QUIET = np.array([4.0, 2.5]), np.array([1.0 / 20.0, 1.0 / 15.0])
_UNLIKE = np.array([2.5, 5.0])
_MOVES_SD = 4.5
_RANGES_SD = 7.0  # the range of sixteen means of white noise exceeds it once in 100,000
_TOLERANCE = np.array([0.05 * DPS] * 3 + [0.6 * MG] * 3)
"""Change of a bias that matters where no filter states its uncertainty: what a converged bias may be uncertain by."""

_SPIKES, _SPIKES_MOVING = (3, 1e-4), (10, 1e-3)
"""Isolated readings that count: how many at least, and of which share of all. Knocks of a moved unit look alike."""
_TURNED = np.array([5.0 * DPS] * 3 + [200.0 * MG] * 3)
"""A unit at rest whose medians of a span move by more has been turned, if they move by more than noise moves them."""
_TURNED_SD = 8.0
_OF_ALL = ("coarse", "repeated", "saturation")
"""Faults that change how often each value comes: zeros then say nothing."""
_REPEATED = 0.015  # share of readings
_HELD = 3  # channels that repeat readings, from which on all are taken to
_WIDE = 0.5  # share of steps of three counts or more in a span that is judged
_FEWEST_SPANS = 4


@dataclass(frozen=True, slots=True)
class Expected:
    """What is known of the unit beside its readings.

    `lsb`: size of a count, rad/s and m/s², shape (6,); None where the source states none.
    `spec`: data sheet of the unit, or of the type that the filter assumes.
    `stated`: whether it is the unit's own.
    `still`: whether the unit is at rest throughout.
    """

    spec: ImuSpec
    lsb: Array | None = None
    stated: bool = True
    still: bool = True


@dataclass(slots=True)
class _Tally:
    """One kind of fault on one channel, over windows."""

    count: int
    since_s: float
    where: str
    densest: float  # largest share of a window's readings


class HealthMonitor:
    """Takes every reading of a unit and reports faults of its channels.

    Equal readings give equal findings, however they are divided among calls of `add`.
    """

    def __init__(self, expected: Expected) -> None:
        self._expected = expected
        self._t = np.empty(_WINDOW)
        self._x = np.empty((_WINDOW, len(CHANNELS) + 1))
        self._filled = self._blocks = self._spans = self._count = 0
        self._looked = -np.inf  # time of the newest reading at the last search, s
        self._slow: list[HealthFinding] = []  # of the last search
        self._standstill = Standstill(len(CHANNELS), resolved=expected.lsb is not None)
        self._copies, self._levels = Copies(len(CHANNELS)), Levels(len(CHANNELS))
        self._zeros = [Zeros() for _ in CHANNELS]
        self._temperatures = Temperatures()
        self._tallies: dict[tuple[str, str], _Tally] = {}
        self._still = expected.still
        self._rest: Array | None = None  # medians of the first span

    def add(self, t: Array, gyro: Array, accel: Array, degc: Array) -> None:
        """Take the next readings.

        `t`: s, shape (n,).
        `gyro`, `accel`: rad/s and m/s² as the instrument shows them, its axes and sign, shape (n, 3); NaN for a channel
          that was not read.
        `degc`: temperature, shape (n,), NaN where it is not known.
        """
        done = 0
        while done < t.size:
            taken = min(_WINDOW - self._filled, t.size - done)
            rows, new = slice(self._filled, self._filled + taken), slice(done, done + taken)
            self._t[rows], self._x[rows, :3], self._x[rows, 3:6] = t[new], gyro[new], accel[new]
            self._x[rows, _TEMPERATURE] = degc[new]
            readings = self._x[rows, :_TEMPERATURE]
            readings[np.isinf(readings)] = np.nan  # no reading either
            self._filled += taken
            done += taken
            self._advance()

    def _advance(self) -> None:
        """Look at the blocks and spans that are full, and at the window if it is."""
        if (blocks := self._filled // BLOCK * BLOCK) > self._blocks:
            rows = slice(self._blocks, blocks)
            self._standstill.add(self._t[rows], self._x[rows, : len(CHANNELS)])
            self._blocks = blocks
        if (spans := self._filled // SPAN * SPAN) > self._spans:
            self._add_spans(slice(self._spans, spans))
            self._spans = spans
        if self._filled == _WINDOW:
            self._count += _WINDOW
            _merge(self._tallies, self._window(_WINDOW, self._zeros), _WINDOW)
            self._filled = self._blocks = self._spans = 0

    def _add_spans(self, rows: slice) -> None:
        """Look at whole spans: copies, noise and trends, and whether the unit was turned."""
        self._temperatures.add(self._t[rows], self._x[rows, _TEMPERATURE])
        t, x = self._t[rows].reshape(-1, SPAN), self._x[rows, : len(CHANNELS)].reshape(-1, SPAN, len(CHANNELS))
        known = np.where(np.isfinite(x), x, 0.0)
        second = known[:, 2:] - 2.0 * known[:, 1:-1] + known[:, :-2]
        means, still = known.mean(axis=1), np.full(len(t), self._still)
        self._rest = np.median(known[0], axis=0) if self._rest is None else self._rest
        if self._still:
            for k in np.flatnonzero((np.abs(means - self._rest) >= _TURNED).any(axis=1)).tolist():
                # isolated readings far off, and noise, turn no unit
                moved = np.abs(np.median(known[k], axis=0) - self._rest)
                if not (moved < np.maximum(_TURNED, _TURNED_SD * _median_sd(second[k]))).all():
                    self._still, still[k:] = False, False
                    break
        self._copies.add(t, second, still)
        if still.any():
            self._levels.add(t[still], means[still], second[still])

    # ---------------------------------------------------------------------------------------------- faults of a window

    def _window(self, count: int, zeros: Sequence[Zeros] = ()) -> list[tuple[DataFault, float]]:
        """Faults of the first `count` readings of the window, each with the time since which it shows."""
        t, x = self._t[:count], self._x[:count, : len(CHANNELS)]
        read = np.asarray(~np.isnan(x).any(axis=0))
        reading = np.where(read, x, 0.0)
        known = np.full((1, len(CHANNELS)), 0.0 if self._still else np.nan)
        _, found = faults.find(t, reading, known, self._expected.lsb, of=self._count + count)
        for c, of_channel in enumerate(zeros if self._still else ()):
            of_channel.add(t, reading[:, c], _smallest_step(reading[:, c]))
        found += _repeated(reading)
        of_channels = {name for c, name in enumerate(CHANNELS) if read[c] and np.ptp(reading[:, c]) > 0.0}
        return [(one, float(t[0])) for one in found if len(one.channels) == 1 and one.channels[0] in of_channels]

    def findings(
        self, bias_sd: Array | None = None, *, moving: bool = True, final: bool = False
    ) -> tuple[HealthFinding, ...]:
        """Report the faults found so far, the worst first.

        `bias_sd`: standard deviations of the biases as a filter states them, rad/s and m/s², instrument axes, shape
          (6,); NaN for one that it does not.
        `moving`: whether a trend of the readings is one of the bias: not where effects in the filter account for it.
        `final`: whether the newest readings are searched for single faults. Else that is done now and then, since it
          costs some 10 ms.
        """
        standing = list(self._still_channels())
        without = {one.channel for one in standing if one.kind in finding.NO_BIAS}
        copied = list(self._copied(without))
        newest = self._standstill.last
        if final or newest - self._looked >= _LOOK_S:
            self._looked = newest
            out = without | {one.channel for one in copied}
            searched = self._searched(final=final)
            self._slow = [*searched, *self._at_rest(bias_sd, out, {one.channel for one in searched}, moving=moving)]
        fault = self._temperatures.found()
        found = [*standing, *copied, *(one for one in self._slow if one.channel not in without)]
        found += [] if fault is None else [of_kind("temperature", "T", *fault)]
        order = list(finding.ADVICE)
        return tuple(sorted(found, key=lambda one: (one.level != "bad", order.index(one.kind))))

    def _searched(self, *, final: bool) -> list[HealthFinding]:
        """Single faults of all windows, the present one among them."""
        tallies, zeros = copy.deepcopy(self._tallies), self._zeros
        if final:
            zeros = copy.deepcopy(zeros)
        if self._filled >= _FEWEST:
            _merge(tallies, self._window(self._filled, zeros if final else ()), self._filled)
        return list(self._single(tallies, zeros))

    def _at_rest(
        self, bias_sd: Array | None, without: set[str], faulty: set[str], *, moving: bool
    ) -> list[HealthFinding]:
        """Noise and trends, which only a unit at rest shows; a trend of a faulty channel is no drift of its bias."""
        if not self._still:
            return []
        found = list(self._noise(without))
        out = without | faulty | {one.channel for one in found}
        return [*found, *self._moving(bias_sd, out)] if moving else found

    def _single(self, tallies: dict[tuple[str, str], _Tally], every_zeros: Sequence[Zeros]) -> Iterator[HealthFinding]:
        """Findings from windows that were searched."""
        total = self._count + self._filled
        spikes, spikes_share = _SPIKES if self._still else _SPIKES_MOVING
        of_all = {channel for effect, channel in tallies if effect in _OF_ALL}
        repeated = {channel for effect, channel in tallies if effect == "repeated"}
        if len(repeated) >= _HELD:  # whole packets are repeated: each extreme value comes several times
            repeated = {*CHANNELS}
        for (effect, channel), one in tallies.items():
            share = max(one.densest, one.count / total)
            match effect:
                case "spikes" if one.count >= spikes and share >= spikes_share:
                    said = f"{channel} has {one.count} isolated readings that are far off ({one.where})"
                    yield of_kind("invalid", channel, one.since_s, said)
                case "saturation" if channel not in repeated:
                    said = f"{channel} is clipped: {one.count} readings pile up {one.where}"
                    yield of_kind("clipped", channel, one.since_s, said)
                case "coarse":
                    said = f"{channel} has lost resolution: it reads in {one.where}"
                    yield of_kind("coarse", channel, one.since_s, said)
                case "repeated":
                    said = f"{channel} repeats {100.0 * one.densest:.0f} % of its readings"
                    yield of_kind("repeated", channel, one.since_s, said)
        for channel, zeros in zip(CHANNELS, every_zeros, strict=True):
            if channel not in of_all and (invalid := zeros.found()) is not None:
                count, since = invalid
                said = f"{channel} reads exactly 0 now and then, {count} times: no reading"
                yield of_kind("invalid", channel, since, said)

    # ------------------------------------------------------------------------------------------- faults of the stream

    def _still_channels(self) -> Iterator[HealthFinding]:
        ended_s, ended_since = self._standstill.frozen_s, self._standstill.frozen_since
        for triad in (slice(0, 3), slice(3, 6)):
            since, changed = self._standstill.still_since(triad)
            for k, c in enumerate(range(triad.start, triad.stop)):
                if np.isnan(self._x[0, c]):
                    continue  # the recording lacks the channel
                name = CHANNELS[c]
                value = f"{self._x[max(self._filled - 1, 0), c] / _UNITS[c]:.6g} {_NAMES[c]}"
                if not np.isnan(since[k]) and not changed[k]:
                    said = f"{name} is dead: it has read {value} and nothing else"
                    yield of_kind("dead", name, float(since[k]), said)
                elif not np.isnan(since[k]):
                    said = f"{name} is frozen at {value} since {since[k]:.1f} s"
                    yield of_kind("frozen", name, float(since[k]), said)
                elif ended_s[c] > 0.0:
                    said = f"{name} was frozen for {ended_s[c]:.1f} s, from {ended_since[c]:.1f} s on"
                    yield of_kind("frozen", name, float(ended_since[c]), said)

    def _copied(self, without: set[str]) -> Iterator[HealthFinding]:
        for pair in self._copies.pairs.values():
            for one, of, ratio in self._copy_and_original(pair.a, pair.b, pair.ratio):
                if {CHANNELS[one], CHANNELS[of]} & without:
                    continue
                shape = "reads the same as" if abs(ratio - 1.0) < 1e-3 else f"is a scaled copy ({ratio:.4g} ×) of"
                apart = f", {pair.late} {'reading' if pair.late == 1 else 'readings'} apart" if pair.late else ""
                yield of_kind("copy", CHANNELS[one], pair.since_s, f"{CHANNELS[one]} {shape} {CHANNELS[of]}{apart}")
        names = {CHANNELS[c] for c in self._copies.sums} - without
        for c, since in self._copies.sums.items():
            others = [name for name in CHANNELS if name in names - {CHANNELS[c]}]
            if CHANNELS[c] in names and len(others) > 1:
                said = f"{CHANNELS[c]} is a sum of multiples of {' and '.join(others)}: it has no noise of its own"
                yield of_kind("copy", CHANNELS[c], since, said)

    def _copy_and_original(self, a: int, b: int, ratio: float) -> Iterator[tuple[int, int, float]]:
        """Which of two channels is the copy: the one less like the others of its kind; both if that does not show."""
        scale = 1.0 if a // 3 == b // 3 else _UNITS[a] / _UNITS[b]
        found = self._levels.density()
        unlike = [0.0, 0.0]
        if found is not None:
            for k, c in enumerate((a, b)):
                own, others = (
                    found[1][c],
                    [found[1][o] for o in range(3 * (c // 3), 3 * (c // 3) + 3) if o not in (a, b)],
                )
                usable = own > 0.0 and min(others) > 0.0
                unlike[k] = abs(np.log(own / np.exp(np.mean(np.log(others))))) if usable else 0.0
        if unlike[1] >= unlike[0] - 0.2:
            yield b, a, ratio * scale
        if unlike[0] >= unlike[1] - 0.2:
            yield a, b, 1.0 / (ratio * scale)

    def _noise(self, without: set[str]) -> Iterator[HealthFinding]:
        """Channels whose noise is far from what the unit can have."""
        found = self._levels.density()
        if found is None:
            return
        slow, fast = found
        spec = self._expected.spec
        sheet = np.array([spec.gyro_arw] * 3 + [spec.accel_vrw] * 3)
        for c, name in enumerate(CHANNELS):
            if name in without or slow[c] <= 0.0:
                continue
            others = [o for o in range(3 * (c // 3), 3 * (c // 3) + 3) if o != c and CHANNELS[o] not in without]
            own = np.array([slow[c], fast[c]])
            usable = [[slow[o], fast[o]] for o in others if slow[o] > 0.0 and fast[o] > 0.0]
            beside = own / np.array(usable).reshape(-1, 2)
            of_sheet, alike = own / sheet[c], len(beside) == 2
            above, below = alike and bool((beside > _UNLIKE).all()), alike and bool((beside < 1.0 / _UNLIKE).all())
            if (of_sheet > _NOISY).all() or above:
                yield of_kind("noisy", name, 0.0, f"{name} has {self._compared(of_sheet, beside if above else None)}")
            elif (of_sheet < _QUIET).all() or below:
                yield of_kind("quiet", name, 0.0, f"{name} has {self._compared(of_sheet, beside if below else None)}")

    def _compared(self, of_sheet: Array, beside: Array | None) -> str:
        """Noise over that of the channels `beside`, or over the data sheet's where there are none."""
        expected = self._expected
        of = f"of its data sheet ({expected.spec.source})" if expected.stated else "that the filter assumes"
        ratio = float(of_sheet[0])
        if beside is not None:
            # single readings of a channel whose noise is below its steps show none
            ratio, of = float(np.exp(np.mean(np.log(beside[:, 0])))), "of the others of its kind"
        return f"{f'{ratio:.3g} times' if ratio > 1.0 else f'1/{1.0 / ratio:.0f} of'} the noise {of}"

    def _moving(self, bias_sd: Array | None, without: set[str]) -> Iterator[HealthFinding]:
        """Channels whose mean moves by more than its stated uncertainty."""
        trend, course = self._levels.trend(), self._levels.excursion()
        if trend is None or course is None:
            return
        change, sd, seconds = trend
        excursion, excursion_sd = course
        stated = 3.0 * bias_sd if bias_sd is not None else _TOLERANCE
        for c, name in enumerate(CHANNELS):
            limit = stated[c] if np.isfinite(stated[c]) else _TOLERANCE[c]
            if name in without or not sd[c] > 0.0:
                continue
            unit = _UNITS[c]
            if abs(change[c]) >= max(_MOVES_SD * sd[c], limit):
                moves = f"moves by {change[c] / unit:+.3g} {_NAMES[c]} in {seconds:.0f} s"
            # a constant may have values up to the limit on either side of it
            elif excursion[c] >= max(_RANGES_SD * excursion_sd[c], 2.0 * limit):
                moves = f"moves to and fro by {excursion[c] / unit:.3g} {_NAMES[c]} in {seconds:.0f} s"
            else:
                continue
            said = f"{name} {moves}, more than the ±{limit / unit:.2g} {_NAMES[c]} that its bias is known to"
            yield of_kind("moving", name, 0.0, said)


def _merge(tallies: dict[tuple[str, str], _Tally], found: Sequence[tuple[DataFault, float]], count: int) -> None:
    """Add the faults of a window of `count` readings."""
    for fault, since in found:
        key = fault.effect, fault.channels[0]
        share = fault.count / count if fault.count >= _SPIKES[0] else 0.0
        known = tallies.get(key)
        if known is None:
            tallies[key] = _Tally(fault.count, since, fault.where, share)
        else:
            known.count += fault.count
            known.densest = max(known.densest, share)


def _median_sd(second: Array) -> Array:
    """Standard deviation that white noise gives the median of a span, by its second differences, (n, channels)."""
    return np.asarray(np.median(np.abs(second), axis=0) / 0.6745 * np.sqrt(np.pi / 12.0 / SPAN))


def _smallest_step(x: Array) -> float:
    """Return the smallest step between successive readings that is not rare; 0 where nothing changes."""
    steps = np.abs(np.diff(x))
    steps = steps[steps > quantisation.rounding(x[1:], x[:-1])]
    return float(np.quantile(steps, 0.01)) if steps.size else 0.0


def _repeated(x: Array) -> list[DataFault]:
    """Channels with far more readings equal to the one before than the steps beside zero allow.

    Readings at the largest and smallest value do not count: a channel at its limit repeats it.
    """
    found = []
    spans = x[: x.shape[0] // SPAN * SPAN].reshape(-1, SPAN, x.shape[1])
    for c, name in enumerate(CHANNELS):
        own = spans[:, :, c]
        steps = np.abs(np.diff(own, axis=1))
        steps[steps <= quantisation.rounding(own[:, 1:], own[:, :-1])] = 0.0
        inside = (own[:, 1:] < own.max()) & (own[:, 1:] > own.min())
        step = _smallest_step(x[:, c])
        wide, moved = (steps > 2.5 * step) & inside, (steps > 0.0) & inside
        # equal readings are common by chance where the noise is of the size of a step
        fine = np.count_nonzero(wide, axis=1) > np.maximum(_WIDE * np.count_nonzero(moved, axis=1), 5)
        if np.count_nonzero(fine) < _FEWEST_SPANS or 2 * np.count_nonzero(fine) < fine.size:
            continue
        equal = int(np.count_nonzero(((steps == 0.0) & inside)[fine]))
        # of the steps within two counts on either side, a quarter as many are expected at zero
        chance = np.count_nonzero((moved & ~wide)[fine]) / 4.0
        if equal - 3.0 * chance > max(_REPEATED * steps[fine].size, 10.0):
            found.append(DataFault("repeated", (name,), equal, f"{equal} of {steps[fine].size} equal the one before"))
    return found
