"""The keeper's process: `python -m imutui.table URL [--limits TEXT]`; `imutui.table.owner` starts it."""

import argparse
import sys

from filters.errors import InputError
from imutui import defects
from imutui.table import keeper
from imutui.table.messages import Report, encode
from imutui.table.motion import parse_limits
from imutui.table.registry import connect


def main() -> int:
    """Keep the table at a URL; returns the exit code. A defect is reported to the owner, without a traceback."""
    asked = argparse.ArgumentParser(prog="python -m imutui.table", description=__doc__)
    asked.add_argument("url")
    asked.add_argument("--limits", default="")
    said = asked.parse_args()
    try:
        given = parse_limits(said.limits)
        return keeper.run(lambda asks: connect(said.url, asks=asks), given)
    except InputError as error:
        _say(str(error))
        return 2
    except Exception as error:  # noqa: BLE001 - the border of a process, whose owner must hear the last words
        _say(f"{defects.told(error)} If the table turns: press its emergency stop.")
        return 4


def _say(error: str) -> None:
    sys.stdout.buffer.write(encode(Report(error=error, ended=True)))
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
