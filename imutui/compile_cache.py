"""Where numba keeps what it compiled: in the user's cache folder, never beside the sources or in site-packages.

Numba looks at the environment when it is imported, so this has to be said before; whoever imports anything of `imutui`
has said it, and the processes that are started from here inherit it. A folder that the user chose (`NUMBA_CACHE_DIR`)
stays. Who uses `filters` alone gets numba's own choice.
"""

import os
import sys

VARIABLE = "NUMBA_CACHE_DIR"
"""Environment variable that numba reads."""


def folder() -> str:
    """Folder for compiled code, inside the user's cache folder (XDG); it need not exist yet."""
    # without `platformdirs` and `pathlib`: until they are loaded, nobody could answer Ctrl+C
    cache = os.environ.get("XDG_CACHE_HOME", "")
    return f"{cache if cache.strip() else os.path.expanduser('~/.cache')}/imutui/numba"  # noqa: PTH111


def use() -> None:
    """Tell numba, and the processes that this one will start, to keep compiled code in `folder`."""
    os.environ.setdefault(VARIABLE, folder())
    if "numba" in sys.modules:  # it has looked already; what was decorated since keeps its own place
        from numba.core import config

        if not config.CACHE_DIR:  # type: ignore[attr-defined]
            config.CACHE_DIR = os.environ[VARIABLE]  # type: ignore[attr-defined]
