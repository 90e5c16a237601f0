"""What is told of a defect: an error of this program's own, and of nothing that it was given."""

import os
import sys
import traceback

from imutui.command_line import joined
from imutui.plain_text import one_line

_LONGEST = 400
_LIBRARIES = ("imutui", "numpy", "numba")
_reports: dict[tuple[type, str, int], str] = {}


def told(error: BaseException) -> str:
    """Write the report of a defect; returns the sentence for whoever has met it.

    The same error at the same place is reported once a process: a campaign, or a viewer, may meet it a million times.
    """
    last = traceback.extract_tb(error.__traceback__)[-1:]
    place = type(error), last[0].filename if last else "", (last[0].lineno or 0) if last else 0
    try:
        if place not in _reports:
            _reports[place] = _written(error)
        how = f"Attach {_reports[place]}, and the recording if it may be shared, to a report"
    except OSError as why:
        how = f"Its details could not be written ({why.strerror}); tell of it"
    what = one_line(f"{type(error).__name__}: {error}".removesuffix("."), _LONGEST)
    return f"a defect of imutui, and not of what it was given: {what}. {how} where imutui was obtained from."


def _written(error: BaseException) -> str:
    """Name of the new file with the report, which its user alone may read."""
    # not before there is a defect: these take longer to load than most commands
    import platform
    import tempfile
    from datetime import UTC, datetime

    descriptor, name = tempfile.mkstemp(prefix="imutui-defect-", suffix=".txt")
    with open(descriptor, "w", encoding="utf-8", errors="backslashreplace") as stream:
        print("time      ", datetime.now(UTC).isoformat(timespec="seconds"), file=stream)
        print("command   ", joined(*sys.argv), file=stream)
        print("process   ", os.getpid(), file=stream)
        for library in _LIBRARIES:
            print(f"{library:<10}", _version(library), file=stream)
        print("python    ", sys.version.replace("\n", " "), file=stream)
        print("platform  ", platform.platform(), file=stream)
        traceback.print_exception(error, file=stream)
    return name


def _version(library: str) -> str:
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version(library)
    except PackageNotFoundError:
        return "not installed"
