"""Allan deviation of a stream of samples of any length, in bounded memory; pure arithmetic.

Overlapping at a stride of an eighth of the averaging time, which costs next to no degrees of freedom.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from filters import allan

Integers = npt.NDArray[np.int64]
Floats = npt.NDArray[np.float64]

_OVERLAP = 8
_FIRST_FACTORS = (1, 2, 4, 8)


@dataclass(frozen=True, slots=True)
class AllanTable:
    """Allan deviations of several channels."""

    factors: Integers  # samples in each mean
    deviation: Floats  # in the samples' unit
    dof: Floats  # equivalent degrees of freedom of each deviation's square


class RunningAllan:
    """Takes samples block by block; differences are never taken across an interruption.

    `channels`: values of a sample.
    """

    def __init__(self, channels: int) -> None:
        self._channels = channels
        self._levels: list[_Level] = []

    def add(self, samples: Integers) -> None:
        """Take the next samples, (n, k) whole numbers: their sums stay exact for ever."""
        number = 0
        while len(samples):
            if number == len(self._levels):
                self._levels.append(_Level(self._channels, (_OVERLAP,) if number else _FIRST_FACTORS))
            samples = self._levels[number].add(samples)
            number += 1

    def interrupt(self) -> None:
        """Take note that the next samples do not follow those before."""
        for level in self._levels:
            level.interrupt()

    def table(self) -> AllanTable:
        """Deviations for averaging times of an octave each, up to a third of what there is."""
        factors, deviations, dof = [], [], []
        for number, level in enumerate(self._levels):
            for m, squares, count in zip(level.factors, level.squares, level.counts.tolist(), strict=True):
                factor, differences = m << number, count << number
                if differences >= factor:
                    factors.append(factor)
                    deviations.append(np.sqrt(squares / (2.0 * count)) / factor)
                    dof.append(_degrees_of_freedom(differences, factor))
        shape = (len(factors), self._channels)
        return AllanTable(np.array(factors, np.int64), np.reshape(np.array(deviations, float), shape), np.array(dof))


class _Level:
    """Sums over spans of one length: squares of their second differences, and the sums of pairs for the next level."""

    def __init__(self, channels: int, factors: tuple[int, ...]) -> None:
        self.factors = factors
        self.squares: Floats = np.zeros((len(factors), channels))
        self.counts: Integers = np.zeros(len(factors), np.int64)
        self._nothing: Integers = np.zeros((0, channels), np.int64)
        self._before = self._odd = self._nothing

    def interrupt(self) -> None:
        """Forget what the next sums would be compared with."""
        self._before = self._odd = self._nothing

    def add(self, sums: Integers) -> Integers:
        """Take the next sums, (n, k); returns sums of pairs."""
        old, every = len(self._before), np.concatenate([self._before, sums])
        total = np.concatenate([np.zeros_like(every[:1]), np.cumsum(every, axis=0)])
        for i, m in enumerate(self.factors):
            # only differences that end with a sum that is new
            part = total[max(old + 1 - 2 * m, 0) :]
            if len(part) > 2 * m:
                second = (part[2 * m :] - 2 * part[m:-m] + part[: -2 * m]).astype(float)
                self.squares[i] += np.einsum("ij,ij->j", second, second)
                self.counts[i] += len(second)
        self._before = every[-(2 * max(self.factors) - 1) :]
        pairs = np.concatenate([self._odd, sums])
        even = len(pairs) - len(pairs) % 2
        self._odd = pairs[even:]
        return np.asarray(pairs[:even:2] + pairs[1:even:2])


def _degrees_of_freedom(differences: int, factor: int) -> float:
    # as of one stretch without a gap that has as many differences; several stretches have a little more
    return float(allan.degrees_of_freedom(differences + 2 * factor - 1, np.array([factor]))[0])
