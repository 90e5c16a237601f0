"""Where numba keeps compiled code: in the user's cache folder, never beside the sources or in site-packages.

Numba reads the environment when it is imported, so `imutui` sets the variable before that, and the processes that it
starts inherit it. A folder that the user chose (`NUMBA_CACHE_DIR`) stays. A program that uses `filters` alone gets
numba's own choice. Where the folder cannot be written, `filters.compilation` compiles without a cache.
"""

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
