"""The compiler of the filters: where numba keeps compiled code, and the memory that a running filter does not need.

Compiled code lies in the user's cache folder, never beside the sources or in site-packages.

Numba reads the environment when it is imported, so `imutui` sets the variable before that, and the processes that it
starts inherit it. A folder that the user chose (`NUMBA_CACHE_DIR`) stays. A program that uses `filters` alone gets
numba's own choice. Where the folder cannot be written, `filters.compilation` compiles without a cache.
"""

import contextlib
import os
import sys

VARIABLE = "NUMBA_CACHE_DIR"
"""Environment variable that numba reads."""


def folder() -> str:
    """Return the folder for compiled code, inside the user's cache folder (XDG); it need not exist yet."""
    # without `platformdirs` and `pathlib`: a process that still loads them cannot answer Ctrl+C
    cache = os.environ.get("XDG_CACHE_HOME", "").strip()
    return f"{cache or os.path.expanduser('~/.cache')}/imutui/numba"  # noqa: PTH111


def use() -> None:
    """Have numba, in this process and in those that it starts, keep compiled code in `folder`."""
    os.environ.setdefault(VARIABLE, folder())
    if "numba" in sys.modules:  # it has read the variable already; functions decorated since keep their own place
        from numba.core import config

        if not config.CACHE_DIR:  # type: ignore[attr-defined]
            config.CACHE_DIR = os.environ[VARIABLE]  # type: ignore[attr-defined]


_LIBRARY = "libllvmlite"
_MADV_DONTNEED = 4


def release() -> None:
    """Give back the memory of the compiler's library, some 70 MB, once the filter's step is loaded.

    Only pages that are an unchanged copy of the library's file are dropped. The system reads a page again from the file
    when a later compilation uses it.
    """
    import ctypes  # an acquisition without a filter does not load it

    libc = ctypes.CDLL(None)
    libc.madvise.argtypes = [ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int]
    libc.malloc_trim(0)
    with contextlib.suppress(OSError), open("/proc/self/smaps", encoding="utf-8") as mappings:
        for line in mappings:
            if line[0] in "0123456789abcdef":
                begin, end = (int(address, 16) for address in line.split(None, 1)[0].split("-"))
                unchanged = _LIBRARY in line
            elif line.startswith(("Anonymous:", "Swap:")):
                unchanged &= line.split()[1] == "0"
            elif line.startswith("VmFlags:") and unchanged:
                libc.madvise(begin, end - begin, _MADV_DONTNEED)


def warning() -> str:
    """Return the sentence for a command that compiles where nothing can be kept; empty where the folder is usable."""
    from imutui.outside_file import can_be_written

    kept = os.environ[VARIABLE]
    if can_be_written(kept):
        return ""
    return (
        f"compiled code cannot be kept: {kept} cannot be written. Each command compiles the filter anew, which takes"
        f" about half a minute. To keep it, name a folder of your own: export {VARIABLE}=FOLDER"
    )
