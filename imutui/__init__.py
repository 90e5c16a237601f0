"""imutui: acquire, calibrate and trace an IMU on a turn table, from a terminal."""

import os

from imutui import compile_cache

__version__: str

# an account that has neither HOME nor an entry among the users: libraries that ask for its folders would raise
if os.path.expanduser("~") == "~":  # noqa: PTH111 - `pathlib` takes long to load
    os.environ["HOME"] = "/nonexistent"
# before anything of this package imports numba
compile_cache.use()


def __getattr__(name: str) -> str:
    """`__version__`, looked up when somebody asks: reading metadata of packages takes longer than most commands."""
    if name != "__version__":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib.metadata import PackageNotFoundError, version

    try:
        found = version("imutui")
    except PackageNotFoundError:  # a source tree that nobody installed
        found = "0+unknown"
    globals()[name] = found  # whoever writes many results asks each time
    return found
