"""Found effects as the filter takes them: regressors from the past alone, sample by sample or many at once.

Temperature and its rate are smoothed causally over some 5 s, which lags no ramp. What a sensor
truly senses is the reference's where that is known, else what it reads. States are in the units of their report; every
regressor is in body axes, SI, as `filters.kalman.augmentation` asks.
"""

import json
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from filters import attitude, earth
from filters.channels import CHANNELS, error_unit
from filters.effects import catalogue
from filters.effects.drivers import PAST_MOTION, SCALARS, Driver
from filters.effects.hypothesis import Hypothesis, Parameter
from filters.effects.inputs import Inputs, levered, tilted
from filters.effects.records import Included
from filters.effects.temperature import CausalTemperature
from filters.errors import InputError
from filters.imu import AxisMap
from filters.motion import kinematics
from filters.motion.reference import FORCE, QUATERNION, RATE
from filters.state import Site
from filters.types import Array

_MEMORY = 5
_NOT_CAUSAL = tuple(f"driver:{name}" for name in PAST_MOTION)

_Bools = NDArray[np.bool_]


class CausalEffects:
    """Effects of one run, `filters.kalman.augmentation.Effects`.

    `included`: what a trace found.
    `correlation`: of all states in order, shape (p, p).
    `axes`: sign and mounting of the unit.
    Raises InputError if an effect is not known, or can't be had from the past alone; the message names it.
    """

    def __init__(
        self, included: Sequence[Included], correlation: Array, axes: AxisMap, site: Site, period: float
    ) -> None:
        self._axes, self._site, self._period = axes, site, period
        for effect in included:
            if effect.effect not in catalogue.EFFECTS and not effect.effect.startswith(("driver:", "cause:")):
                raise InputError(f'`effect` is "{effect.effect}", which is none of the catalogue')
            if effect.include_as in "AS" and not effect.states:
                raise InputError(f'"{effect.effect}" has no states: without them it changes nothing')
        self._parts = [(h := _part(effect), h.blank()) for effect in included if effect.states]
        self._chains = [own for _, own in self._parts if own.size]
        states = [(effect, state) for effect in included for state in effect.states]
        self.names = tuple(f"{'/'.join(e.channels)} {e.effect} {s.name} ({s.unit})" for e, s in states)
        self.mean = np.array([s.mean for _, s in states])
        sd = np.array([s.sd for _, s in states])
        self.covariance = correlation * np.outer(sd, sd)
        self.tau = np.array([s.tau_s for _, s in states])
        self.q = np.array([s.q for _, s in states])
        self._levels = [effect for effect in included if effect.effect == "noise_level"]
        self._gates = [effect for effect in included if effect.include_as == "P"]
        self._thermal = CausalTemperature(period)
        self._last: tuple[float, Array, Array] | None = None
        self._recent = np.full((_MEMORY, 6), np.nan)
        self._C = np.eye(3)[None]

    def memory(self) -> str:
        """What terms that remember anything do remember, for `restore`; "" before any temperature is known."""
        thermal = self._thermal.memory()
        return json.dumps({**json.loads(thermal), "chains": [own.tolist() for own in self._chains]}) if thermal else ""

    def restore(self, memory: str) -> None:
        """Go on from what the effects of the file before remembered, before the first sample is shown.

        Raises InputError if the text is none that `memory` gave.
        """
        self._thermal.restore(memory)
        try:
            found = [np.array(own, np.float64).reshape(-1, 2) for own in json.loads(memory).get("chains", [])]
        except (TypeError, ValueError) as error:
            raise InputError(f"the memory of chains does not read as one ({error})") from error
        if [own.shape for own in found] == [own.shape for own in self._chains]:
            for own, before in zip(self._chains, found, strict=True):
                own[:] = before

    def look_ahead(self, temperature: Array) -> None:
        """Take the temperatures of all samples before the first is shown, degC: regressors are then the tracer's."""
        self._thermal.look_ahead(temperature)

    def rows(
        self, t: Array, gyro: Array, accel: Array, temperature: Array, known: Array
    ) -> tuple[Array, Array, _Bools]:
        """Regressor, noise and use of the next samples; see `filters.kalman.augmentation.Effects`."""
        reading = np.hstack([self._axes.gyro_to_instrument(gyro), self._axes.accel_to_instrument(accel)])
        inputs = self._inputs(t, reading, temperature, known)
        phi = np.zeros((t.size, 6, len(self.names)))
        at = 0
        for h, memory in self._parts:
            scale, columns = np.array([p.si for p in h.parameters]), np.zeros((t.size, 6, len(h.parameters)))
            for c in h.channels:
                columns[:, c] = h.going_on(inputs, c, memory)
            phi[:, :, at : at + scale.size] = self._in_body(columns, scale)
            at += scale.size
        return phi, self._noise(inputs), self._use(reading, inputs)

    def _in_body(self, columns: Array, scale: Array) -> Array:
        """To body axes, accelerometer first, and to the units of the states."""
        turned = np.moveaxis(columns * scale, 1, 2)
        accel, gyro = self._axes.accel_to_body(turned[..., 3:]), self._axes.gyro_to_body(turned[..., :3])
        return np.moveaxis(np.concatenate([accel, gyro], axis=2), 2, 1)

    # --------------------------------------------------------------------------------------------------- inputs

    def _inputs(self, t: Array, reading: Array, temperature: Array, known: Array) -> Inputs:
        n = t.size
        rate, force = known[:, RATE], known[:, FORCE]
        sensed = np.hstack([self._axes.gyro_to_instrument(rate), self._axes.accel_to_instrument(force)])
        have = np.asarray(np.isfinite(sensed).all(axis=1))
        x = np.where(have[:, None], np.nan_to_num(sensed), reading)
        C = self._attitudes(known)
        # written out, since a product of matrices may add in an order that depends on how many samples come at once
        north, _, down = earth.earth_rate_n(np.array(self._site.latitude)).tolist()
        spin_b = north * C[:, 0] + down * C[:, 2]
        turning = self._axes.gyro_to_body(x[:, :3]) - spin_b
        x_dot, turning_dot = self._slopes(t, x, turning)
        T = self._thermal.follow(temperature)
        zero = np.zeros((n, 3))
        return Inputs(
            t=t,
            x=x,
            x_dot=x_dot,
            temperature=T.level,
            temperature_rate=T.rate,
            lagged=T.lagged,
            plays=T.plays,
            spin=self._axes.gyro_to_instrument(spin_b),
            horizontal=tilted(self._axes, C, self._site.gravity),
            centripetal=levered(self._axes, turning, turning_dot),
            angles=kinematics.angles_of(C),
            rates=zero,
            table_accel=np.zeros(n),
            since_motion=np.zeros(n),
            direction=zero,
            followed=np.column_stack([x, np.linalg.norm(x[:, :3], axis=1)]),
        )

    def _attitudes(self, known: Array) -> Array:
        """C_nb of each sample; the last known one where the reference says nothing."""
        q = known[:, QUATERNION]
        have = np.asarray(np.isfinite(q).all(axis=1))
        last = np.maximum.accumulate(np.where(have, np.arange(len(q)), -1))
        C = np.where((last >= 0)[:, None, None], attitude.from_quaternion(q[np.maximum(last, 0)]), self._C)
        self._C = C[-1:].copy()
        return C

    def _slopes(self, t: Array, x: Array, turning: Array) -> tuple[Array, Array]:
        """Derivatives by backward differences; zero for the first sample."""
        before = self._last or (t[0] - self._period, x[0], turning[0])
        dt = np.diff(t, prepend=before[0])[:, None]
        out = np.diff(x, axis=0, prepend=before[1][None]) / dt, np.diff(turning, axis=0, prepend=before[2][None]) / dt
        self._last = float(t[-1]), x[-1].copy(), turning[-1].copy()
        return out

    # -------------------------------------------------------------------------------------------- noise and use

    def _noise(self, inputs: Inputs) -> Array:
        """Factor on the standard deviation of white noise, body axes, accelerometer first, shape (N, 6)."""
        out = np.ones((inputs.t.size, 6))
        for level in self._levels:
            value = SCALARS[str(level.parameters["driver"])][1](inputs)
            ratio = np.interp(value, level.numbers("knots"), level.numbers("ratio"))
            for name in level.channels:
                out[:, CHANNELS.index(name)] *= ratio
        mount = np.abs(self._axes.mount)
        return np.hstack([out[:, 3:] @ mount.T, out[:, :3] @ mount.T])

    def _use(self, reading: Array, inputs: Inputs) -> _Bools:
        """Whether each sample is a reading: no spike, not at a limit."""
        use = np.ones(len(reading), bool)
        if not self._gates:
            return use
        e = reading - inputs.x
        past = np.vstack([self._recent, e])
        self._recent = past[-_MEMORY:].copy()
        for gate in self._gates:
            for c in (CHANNELS.index(name) for name in gate.channels):
                limit = gate.number("limit") * error_unit(c)[1]
                if gate.effect == "saturation":
                    use &= np.abs(reading[:, c]) < limit * (1.0 - 1e-6)
                else:
                    windows = np.lib.stride_tricks.sliding_window_view(past[:-1, c], _MEMORY)
                    middle = np.where(np.isnan(windows).any(axis=1), e[:, c], np.median(windows, axis=1))
                    use &= np.abs(e[:, c] - middle) <= limit
        return use


def _part(effect: Included) -> Hypothesis:
    if effect.effect in ("random_walk", "gauss_markov", "tone"):
        return _process(effect)
    past = effect.effect.startswith(_NOT_CAUSAL)
    h = None if past else catalogue.hypothesis(effect.effect, effect.channels, effect.parameters)
    if h is None or (isinstance(h, Driver) and not h.in_filter):
        raise InputError(
            f'"{effect.effect}" follows past motion of the table, which the filter does not keep:'
            " take it out of the file"
        )
    if len(h.parameters) != len(effect.states):
        raise InputError(f'"{effect.effect}" has {len(h.parameters)} states, and the file gives {len(effect.states)}')
    for p, state in zip(h.parameters, effect.states, strict=True):
        if p.unit != state.unit:
            raise InputError(f'`unit` of {effect.effect} {state.name} is "{state.unit}", not "{p.unit}"')
    return h


def _process(effect: Included) -> Hypothesis:
    """A drift, which is its state, or a tone, whose states are those of its sine and cosine."""
    channel, hz = CHANNELS.index(effect.channels[0]), effect.number("hz", 0.0)

    def columns(inputs: Inputs, channel: int) -> Array:
        phase = 2.0 * np.pi * hz * inputs.t
        return np.stack([np.sin(phase), np.cos(phase)], axis=1) if hz > 0.0 else np.ones((inputs.t.size, 1))

    own = tuple(Parameter(state.name, state.unit, error_unit(channel)[1], 0.0) for state in effect.states)
    channels = tuple(CHANNELS.index(name) for name in effect.channels)
    return Hypothesis(effect=effect.effect, channels=channels, source="time", parameters=own, columns=columns)
