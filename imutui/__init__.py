"""imutui: acquire, calibrate and trace an IMU on a turn table, from a terminal."""

from importlib.metadata import PackageNotFoundError, version

from imutui import compile_cache

try:
    __version__ = version("imutui")
except PackageNotFoundError:  # a source tree that nobody installed
    __version__ = "0+unknown"

# before anything of this package imports numba
compile_cache.use()
