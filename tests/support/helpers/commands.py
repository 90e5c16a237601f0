"""Commands of imutui, called in this process or run in one of their own."""

import io
import json
import os
import subprocess
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from typing import Any
from unittest.mock import patch

from helpers.processes import LIMIT_S, command_line
from imutui import cli

Done = subprocess.CompletedProcess[str]


def imutui(*arguments: object, check: int | None = 0) -> Done:
    """Call a command here: arguments, streams and exit code are as of a process, which takes seconds to start.

    `*arguments`: as on the command line.
    `check`: what the exit code must be.
    """
    out, err = (io.TextIOWrapper(io.BytesIO(), encoding="utf-8", write_through=True) for _ in range(2))
    with (
        open(os.devnull) as stdin,
        patch.object(sys, "argv", ["imutui", *map(str, arguments)]),
        patch.object(sys, "stdin", stdin),
        # else that of whoever runs the tests would be looked at, with `pytest -s`
        patch.dict(os.environ, {"COLUMNS": "80", "LINES": "25"}),
        redirect_stdout(out),
        redirect_stderr(err),
        _warnings_as_in_a_process(),
    ):
        try:
            cli.main()
            code = 0
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else int(end.code is not None)
    told = [stream.buffer.getvalue().decode() for stream in (out, err)]  # type: ignore[attr-defined]
    return _checked(Done([*arguments], code, *told), check)


def imutui_json(*arguments: object, check: int | None = 0) -> Any:
    """What it prints with --json."""
    return json.loads(imutui(*arguments, "--json", check=check).stdout)


def imutui_process(*arguments: object, check: int | None = 0) -> Done:
    """The same in a process of its own, for what only a process can show."""
    line = command_line(*map(str, arguments))
    done = subprocess.run(line, capture_output=True, text=True, timeout=LIMIT_S, stdin=subprocess.DEVNULL, check=False)
    return _checked(done, check)


def _checked(done: Done, check: int | None) -> Done:
    if check is not None:
        assert done.returncode == check, f"exit {done.returncode}\n{done.stdout}\n{done.stderr}"
        assert "a defect of imutui" not in done.stderr, done.stderr
    assert "Traceback" not in done.stderr
    return done


@contextmanager
def _warnings_as_in_a_process() -> Iterator[None]:
    """On stderr, where a user would see them, instead of in pytest's list."""
    with warnings.catch_warnings():
        warnings.simplefilter("default")
        for kind in (DeprecationWarning, PendingDeprecationWarning, ImportWarning, ResourceWarning):
            warnings.simplefilter("ignore", kind)
        warnings.simplefilter("error", RuntimeWarning)  # as in all tests
        warnings.showwarning = lambda *told: print(warnings.formatwarning(*told[:4]), file=sys.stderr)
        yield
