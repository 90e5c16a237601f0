"""Compile functions with numba, and keep the machine code on disk where a folder for it can be written."""

import functools
from collections.abc import Callable
from typing import Any

from filters.errors import InputError


@functools.cache
def cached_njit(function: Callable[..., Any]) -> Any:
    """Compile a function that Python calls: numpy's rules of arithmetic, no lock held, kept on disk.

    Numba notices a change of the function's own file alone. Without a folder that can be written, the function is
    compiled anew in each process.

    Raises
    ------
    InputError
        If NUMBA_DISABLE_JIT is set: numba then compiles nothing, and the filters need minutes for seconds of data.
    """
    import numba  # here, because a program that compiles nothing must not wait for it

    if numba.config.DISABLE_JIT:  # type: ignore[attr-defined]
        raise InputError(
            "NUMBA_DISABLE_JIT is set, and the filters need compiled code: type `unset NUMBA_DISABLE_JIT`, then the"
            " same command again"
        )
    made = numba.njit(nogil=True, error_model="numpy", fastmath=False)(function)
    try:
        made.enable_caching()
    except RuntimeError as error:
        if "cannot cache function" not in str(error):
            raise
    return made
