"""Which walk over a log's records pays: the plain one, which is there at once, or the compiled one, which is faster.

Both say the same. Loading the compiler takes as long as the plain walk takes over many megabytes; where a filter is to
run it is loaded anyway. Where the kernels are loaded already, as when one log after the other is read, they always pay.
"""

import sys
from typing import NamedTuple, Protocol

import numpy as np

from imutui.logbook import plain_walk
from imutui.logbook.message_layout import RecordTable

COMPILER_PAYS_BYTES = 20 * 2**20
"""Size of a log from which on loading the compiler for its sake pays."""
KERNELS_PAY_BYTES = 2 * 2**20
"""Size of a log from which on loading the kernels pays where the compiler is loaded anyway."""


class _EndOfWhole(Protocol):
    def __call__(self, data: np.ndarray, limit: int, /) -> int: ...


class _Tabulate(Protocol):
    def __call__(self, data: np.ndarray, limit: int, wanted: np.ndarray, /) -> RecordTable: ...


class _Tally(Protocol):
    def __call__(self, table: np.ndarray, roles: np.ndarray, /) -> tuple[np.ndarray, np.ndarray]: ...


class _Gather(Protocol):
    def __call__(
        self,
        data: np.ndarray,
        table: np.ndarray,
        roles: np.ndarray,
        imu: np.ndarray,
        temperature: np.ndarray,
        raw: np.ndarray,
        motion: np.ndarray,
        /,
    ) -> bool: ...


class Walk(NamedTuple):
    """The walks over records and the fields of our messages; see `plain_walk` for each."""

    end_of_whole: _EndOfWhole
    tabulate: _Tabulate
    tally: _Tally
    gather: _Gather


PLAIN = Walk(plain_walk.end_of_whole, plain_walk.tabulate, plain_walk.tally, plain_walk.gather)


def compiled() -> Walk:
    """The compiled walks; loads the compiler."""
    from imutui.logbook import mcap_kernels

    return Walk(mcap_kernels.end_of_whole, mcap_kernels.tabulate, mcap_kernels.tally, mcap_kernels.gather)


def for_reading(size: int) -> Walk:
    """Walks over a log of so many bytes where nothing else needs the compiler."""
    return compiled() if size >= COMPILER_PAYS_BYTES or _is_loaded() else PLAIN


def for_filtering(size: int) -> Walk:
    """Walks over a log of so many bytes that a filter is to take."""
    return compiled() if size >= KERNELS_PAY_BYTES or _is_loaded() else PLAIN


def _is_loaded() -> bool:
    return "imutui.logbook.mcap_kernels" in sys.modules
