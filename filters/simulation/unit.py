"""Units: readings at the loop's rate from a scenario, as arrays or one after the other, the same numbers either way."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from filters.errors import InputError
from filters.first_order import first_order
from filters.imu import IMU400CD_200, LOOP_HZ, ImuSpec, Samples
from filters.motion.profile import Profile
from filters.simulation.additive import Additive
from filters.simulation.background import Background, RecordedMotion, RecordedTemperature
from filters.simulation.catalogue import EFFECTS, Effect
from filters.simulation.output import (
    Bandwidth,
    Coarse,
    Dropout,
    Jitter,
    NoiseCrosstalk,
    NoiseLevel,
    Output,
    Saturation,
    Spikes,
    Stuck,
)
from filters.simulation.parameters import EffectKind, TrueInputs
from filters.simulation.scenario import Scenario, Temperature, Truth, draw
from filters.simulation.truth import Motion, MotionEffect, World
from filters.simulation.turn_table import OnTable
from filters.state import PAPER_SITE, Site
from filters.types import Array

# Readings come in blocks of this many whoever asks: noise and memories then cannot depend on how they are asked for.
_BLOCK = 1024

# what is drawn, as the second word of a generator's seed
_NOISE, _EFFECT, _RUN = 1, 2, 3

# from sensor to register: what is behind acts on what came before
_OUTPUT_ORDER = (Saturation, Coarse, Stuck, Spikes)

# what changes made noise: a recording has its own
_OF_NOISE = (NoiseLevel, NoiseCrosstalk, Bandwidth)

Made = list[tuple[int, EffectKind]]  # effects at work, and the numbers of their channels


@dataclass(frozen=True, slots=True)
class Recording:
    """Readings with what only a simulation knows, of the same N instants."""

    samples: Samples  # stamps, rates and specific forces, body axes
    number: NDArray[np.int_]  # number of each reading since power-on, shape (N,); lost ones are missing
    temperature_degc: Array  # shape (N,)
    # angles, rates: rotations of the table about north, east, down and their derivatives, rad and rad/s, shape (N, 3)
    angles: Array
    rates: Array
    truth: Truth  # biases


@dataclass(frozen=True, slots=True)
class _Block:
    """Successive readings."""

    stamps: Array  # (N,), s since power-on, as they arrive
    gyro: Array  # (N, 3), body
    accel: Array  # (N, 3), body
    temperature: Array  # (N,)
    lost: NDArray[np.bool_]  # (N,)


class Unit:
    """A unit at one of its power-ons.

    `scenario`: unit, motion, effects.
    `power_on`: which, from 0.
    `rate_hz`: readings a second.
    `background`: a recording that is played in place of biases and noise that are drawn: the scenario's motion, its
      effects and the biases that it names are added. Temperature is the scenario's where it has one, else the
      recording's.
    `table`: what it stands on in place of the scenario's motion; readings are made up to what the table has done.
    Raises InputError if the scenario has no such power-on, the rate is not positive, or something can't be added to the
      recording.
    """

    def __init__(
        self,
        scenario: Scenario,
        power_on: int = 0,
        rate_hz: float = LOOP_HZ,
        background: Background | None = None,
        table: OnTable | None = None,
    ) -> None:
        if not 0 <= power_on < len(scenario.power_ons):
            raise InputError(f"`power_on` is {power_on}; the scenario has 0 to {len(scenario.power_ons) - 1}")
        if not 0.0 < rate_hz < np.inf:
            raise InputError(f"`rate_hz` is {rate_hz}, not positive")
        self.scenario = scenario
        self.power_on = power_on
        self.rate_hz = rate_hz
        self.background = background
        self.motion: Motion | None = scenario.profile if table is None else table
        self._table = table
        self.temperature = _temperature(scenario, power_on, background)
        self.truth = _biases(scenario, power_on, made=background is None)
        self._blocks = self._stream()
        self._start = self._end = 0
        noisy = [effect.name for effect in scenario.effects if issubclass(EFFECTS[effect.name], _OF_NOISE)]
        if background is not None and noisy:
            raise InputError(f"{noisy[0]} changes noise that is made; a recording has its own: leave {noisy[0]} out")
        if table is None:
            self._go_on()

    def block(self, k: int) -> int:
        """How many readings from k on can be made now, at least one and no more than there are in a block."""
        if self._table is None:
            return _BLOCK
        return min(max(math.floor(self._table.known() * self.rate_hz) + 1 - k, 1), _BLOCK)

    def reading(self, k: int) -> tuple[Array, Array]:
        """Rate (rad/s) and specific force (m/s²) of reading k, body axes, shape (3,); k must not go back a block.

        A lost reading is given too: `lost` says so.
        """
        row = self._row(k)
        return self._block.gyro[row], self._block.accel[row]

    def lost(self, k: int) -> bool:
        """Whether reading k never arrives; k as in `reading`."""
        row = self._row(k)
        return bool(self._block.lost[row])

    def late(self, k: int) -> float:
        """Error of the stamp of reading k, s; k as in `reading`."""
        row = self._row(k)
        return float(self._block.stamps[row]) - k / self.rate_hz

    def temperature_degc(self, k: int) -> float:
        """Temperature inside the case at reading k, degC."""
        return float(self.temperature.at(np.array([k / self.rate_hz]))[0])

    def sensed(self) -> World | RecordedMotion:
        """What there is to sense, without the scenario's effects."""
        scenario, background = self.scenario, self.background
        if background is not None and self.motion is None:
            return background.motion
        return World(self.motion, scenario.site, scenario.axes)

    def samples(self, count: int) -> Samples:
        """What arrives of readings 0 to `count` - 1; the unit is not used up."""
        return self.record(count).samples

    def record(self, count: int) -> Recording:
        """What arrives of readings 0 to `count` - 1, and the truth beside it; the unit is not used up.

        `count`: readings made.
        """
        if count < 0:
            raise ValueError(f"`count` is {count}, negative")
        blocks = [block for block, _ in zip(self._stream(), range(0, max(count, 1), _BLOCK), strict=False)]
        kept = np.flatnonzero(~np.concatenate([block.lost for block in blocks])[:count])
        gyro, accel, stamps, temperature = (
            np.concatenate([getattr(block, name) for block in blocks])[kept]
            for name in ("gyro", "accel", "stamps", "temperature")
        )
        t, motion = kept / self.rate_hz, World(self.motion, self.scenario.site, self.scenario.axes)
        samples = Samples(stamps, gyro, accel)
        return Recording(samples, kept, temperature, motion.angles(t), motion.rates(t), self.truth)

    def _row(self, k: int) -> int:
        if k < self._start:
            raise ValueError(f"`k` is {k}: readings before {self._start} are gone")
        while k >= self._end:
            self._go_on()
        return k - self._start

    def _go_on(self) -> None:
        self._block = next(self._blocks)
        self._start, self._end = self._end, self._end + self._block.stamps.size

    # ---------------------------------------------------------------------------------------------- how they are made

    def _stream(self) -> Iterator[_Block]:
        """Blocks of readings from power-on."""
        scenario, axes = self.scenario, self.scenario.axes
        made = [pair for number, effect in enumerate(scenario.effects) for pair in self._made(number, effect)]
        world, moved = self._world(made)
        errors = [(channel, thing) for channel, thing in made if isinstance(thing, Additive)]
        outputs = [(channel, thing) for channel, thing in made if isinstance(thing, Output)]
        outputs.sort(key=lambda pair: _OUTPUT_ORDER.index(type(pair[1])))
        poles = _poles(scenario.spec, made, self.rate_hz)
        band = _BandLimit(poles, is_settled=False)
        noise = _noise(self, made, _BandLimit(poles)) if self.background is None else _played(self.background)
        bias = np.concatenate(
            [axes.gyro_to_instrument(self.truth.gyro_bias), axes.accel_to_instrument(self.truth.accel_bias)]
        )
        end = 0
        while True:
            start, end = end, end + self.block(end)
            t = np.arange(start, end) / self.rate_hz
            inputs = TrueInputs(t, world.perfect(t), self.temperature.at(t), self.temperature.rate(t), world.angles(t))
            values = moved(inputs) + bias
            for channel, error in errors:
                values[:, channel] += error.error(inputs)
            if errors or self.motion is not None:
                values = band.limited(values)
            values += noise(inputs)
            for channel, output in outputs:
                values[:, channel] = output.spoiled(values[:, channel], t)
            late = sum((thing.late(t) for _, thing in made if isinstance(thing, Jitter)), np.zeros(t.size))
            lost = np.zeros(t.size, bool)
            for _, thing in made:
                if isinstance(thing, Dropout):
                    lost |= thing.lost(t)
            gyro, accel = axes.gyro_to_body(values[:, :3]), axes.accel_to_body(values[:, 3:])
            yield _Block(t + late, gyro, accel, inputs.temperature, lost)

    def _world(self, made: Made) -> tuple[World | RecordedMotion, Callable[[TrueInputs], Array]]:
        """What is sensed with the effects of motion, and what of it comes to the readings.

        A recording has sensed its own motion: to that only what the scenario changes is added.
        """
        scenario, background = self.scenario, self.background
        still = World(None, scenario.site, scenario.axes)
        world = replace(still, profile=self.motion)
        changes = [thing for _, thing in made if isinstance(thing, MotionEffect)]
        for thing in changes:
            world = thing.changed(world)
        if background is None:
            return world, lambda inputs: inputs.perfect
        if self.motion is None and not changes:
            return background.motion, lambda inputs: np.zeros((inputs.t.size, 6))
        rest = still.perfect(np.zeros(1))
        background.check_rest(rest[0], scenario.site.gravity)
        return world, lambda inputs: inputs.perfect - rest

    def _made(self, number: int, effect: Effect) -> Made:
        key = [_seed(self.scenario, self.power_on), _EFFECT, self.power_on, number]
        return effect.made(self.rate_hz, lambda channel: np.random.default_rng([*key, channel]))


class StillUnit(Unit):
    """A still, level unit with nothing wrong but its biases, drawn within the specification, and noise.

    `seed`: of biases and noise.
    `rate_hz`: readings a second of unit time.
    `site`: where it stands.
    `spec`: noise densities, bandwidths, bias limits.
    """

    def __init__(self, seed: int, rate_hz: float, site: Site = PAPER_SITE, spec: ImuSpec = IMU400CD_200) -> None:
        super().__init__(Scenario(seed=seed, site=site, spec=spec), rate_hz=rate_hz)


def simulate(
    profile: Profile | None = None,
    *,
    rate_hz: float,
    seconds: float,
    seed: int = 0,
    spec: ImuSpec = IMU400CD_200,
    truth: Truth | None = None,
    effects: tuple[Effect, ...] = (),
    site: Site = PAPER_SITE,
    band_limit: bool = False,
) -> tuple[Samples, Truth]:
    """Samples for a filter's tests: the truth at the instants k / rate, plus bias, effects and white noise.

    Noise of a sample has standard deviation density · √rate: what a filter with that specification believes.

    `profile`: motion from the first sample on; level and still without.
    `rate_hz`, `seconds`: ``round(seconds * rate_hz)`` samples.
    `seed`: of noise, random effects, and biases that are not given.
    `spec`: densities, bias limits.
    `truth`: biases, body axes; drawn within the limits if None.
    `effects`: in the axes and sign of an instrument that sits straight on the table and reads +1 g when level.
    `site`: where the table stands.
    `band_limit`: whether the specification's bandwidths act, on signal and noise.
    Returns body axes.
    Returns biases.
    """
    if not band_limit:
        spec = replace(spec, gyro_bandwidth=0.0, accel_bandwidth=0.0)
    scenario = Scenario(seed=seed, spec=spec, effects=effects, profile=profile, site=site)
    if truth is not None:
        accel = scenario.axes.accel_to_instrument(truth.accel_bias)
        gyro = scenario.axes.gyro_to_instrument(truth.gyro_bias)
        scenario = replace(scenario, accel_bias=tuple(accel.tolist()), gyro_bias=tuple(gyro.tolist()))
    unit = Unit(scenario, rate_hz=rate_hz)
    return unit.samples(round(seconds * rate_hz)), unit.truth


def _seed(scenario: Scenario, power_on: int) -> int:
    own = scenario.power_ons[power_on].seed
    return scenario.seed if own is None else own


def _temperature(scenario: Scenario, power_on: int, background: Background | None) -> Temperature | RecordedTemperature:
    own = scenario.power_ons[power_on].temperature or scenario.temperature
    if background is None or background.temperature is None or own.points:
        return own
    return background.temperature


def _biases(scenario: Scenario, power_on: int, *, made: bool) -> Truth:
    """Biases of a unit at a power-on, body axes; where they are not made, those that come to a recording's."""
    axes, this = scenario.axes, scenario.power_ons[power_on]
    drawn = draw(scenario.seed, scenario.spec) if made else Truth(np.zeros(3), np.zeros(3))
    rng = np.random.default_rng([_seed(scenario, power_on), _RUN, power_on])
    accel_more = rng.standard_normal(3) * scenario.accel_bias_run_sd
    gyro_more = rng.standard_normal(3) * scenario.gyro_bias_run_sd
    accel = axes.accel_to_body(np.array(scenario.accel_bias)) if scenario.accel_bias else drawn.accel_bias
    gyro = axes.gyro_to_body(np.array(scenario.gyro_bias)) if scenario.gyro_bias else drawn.gyro_bias
    return Truth(
        axes.accel_to_body(np.array(this.accel_bias)) if this.accel_bias else accel + accel_more,
        axes.gyro_to_body(np.array(this.gyro_bias)) if this.gyro_bias else gyro + gyro_more,
    )


def _poles(spec: ImuSpec, made: Made, rate_hz: float) -> Array:
    """Poles of the six first-order band limits; 0 where there is none."""
    hz = np.repeat([spec.gyro_bandwidth, spec.accel_bandwidth], 3)
    for channel, thing in made:
        if isinstance(thing, Bandwidth):
            hz[channel] = thing.number("hz")
    return np.where(hz > 0.0, np.exp(-2.0 * np.pi * hz / rate_hz), 0.0)


class _BandLimit:
    """First-order band limits of unit gain at zero frequency: a density that a filter integrates passes unchanged.

    Unless `is_settled`, from nothing before, the first values of all have been there for ever.
    """

    def __init__(self, poles: Array, *, is_settled: bool = True) -> None:
        self._poles, self._memory, self._is_settled = poles, np.zeros(6), is_settled

    def limited(self, values: Array) -> Array:
        """The next values, shape (N, 6)."""
        if not self._is_settled:
            self._memory[:], self._is_settled = self._poles * values[0], True
        out = np.empty_like(values)
        for c, pole in enumerate(self._poles.tolist()):
            out[:, c], self._memory[c] = first_order(values[:, c], 1.0 - pole, pole, self._memory[c])
        return out


def _noise(unit: Unit, made: Made, band: _BandLimit) -> Callable[[TrueInputs], Array]:
    """What gives the band-limited noise of the next readings, instrument axes, shape (N, 6)."""
    spec, axes = unit.scenario.spec, unit.scenario.axes
    rng = np.random.default_rng([_seed(unit.scenario, unit.power_on), _NOISE, unit.power_on])
    sd = np.repeat([spec.gyro_arw, spec.accel_vrw], 3) * np.sqrt(unit.rate_hz)

    def following(inputs: TrueInputs) -> Array:
        # drawn in body axes: one seed gives one physics however the unit sits and whatever sign it reads with
        drawn = rng.standard_normal((inputs.t.size, 6))
        white = np.hstack([axes.gyro_to_instrument(drawn[:, :3]), axes.accel_to_instrument(drawn[:, 3:])])
        for _, thing in made:
            if isinstance(thing, NoiseCrosstalk):
                white = thing.mixed(white)
        white = white * sd
        for channel, thing in made:
            if isinstance(thing, NoiseLevel):
                white[:, channel] *= thing.ratio(inputs)
        return band.limited(white)

    return following


def _played(background: Background) -> Callable[[TrueInputs], Array]:
    """What gives the next readings of a recording, in place of noise, instrument axes, shape (N, 6)."""
    return lambda inputs: background.readings(inputs.t)
