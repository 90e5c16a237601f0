"""Where numba keeps what it compiled: in the user's cache folder, never beside the sources or in site-packages.

Numba looks at the environment when it is imported, so this has to be said before; whoever imports anything of `imutui`
has said it, and the processes that are started from here inherit it. A folder that the user chose (`NUMBA_CACHE_DIR`)
stays. Who uses `filters` alone gets numba's own choice.
"""

import os
import sys
from pathlib import Path

import platformdirs

VARIABLE = "NUMBA_CACHE_DIR"
"""Environment variable that numba reads."""


def folder() -> Path:
    """Folder for compiled code, inside the user's cache folder; it need not exist yet."""
    return Path(platformdirs.user_cache_dir("imutui")) / "numba"


def use() -> None:
    """Tell numba, and the processes that this one will start, to keep compiled code in `folder`."""
    os.environ.setdefault(VARIABLE, str(folder()))
    if "numba" in sys.modules:  # it has looked already; what was decorated since keeps its own place
        from numba.core import config

        if not config.CACHE_DIR:  # type: ignore[attr-defined]
            config.CACHE_DIR = os.environ[VARIABLE]  # type: ignore[attr-defined]
