"""A page as PDF, printed by a browser if one is at hand. The only place that starts one."""

import os
import shutil
import subprocess
import tempfile
from pathlib import Path

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
_LONGEST_S = 120.0
_WORDS = 160


class PrintError(Exception):
    """A browser that is there did not print; the message says what it said."""


def browser() -> str | None:
    """Path of a browser that can print without a screen; None without one."""
    return next((found for name in BROWSERS if (found := shutil.which(name))), None)


def print_page(page: Path, output: Path, program: str) -> None:
    """Print a page on A4.

    `page`: HTML.
    `output`: PDF, in a folder that there is; replaced.
    `program`: as `browser` gives it.
    Raises PrintError if nothing was printed.
    """
    # beside the page: a browser in a container of its own sees no other temporary folder
    with tempfile.TemporaryDirectory(prefix=".print-", dir=output.parent) as own:
        made = Path(own) / "page.pdf"
        command = [program, "--headless", "--disable-gpu", "--no-first-run", f"--user-data-dir={own}/profile"]
        command += ["--disable-background-networking", "--no-pdf-header-footer", f"--print-to-pdf={made.resolve()}"]
        # as root there is no sandbox, and the page has no script
        command += ["--no-sandbox"] if os.geteuid() == 0 else []
        try:
            done = subprocess.run(
                [*command, page.resolve().as_uri()], capture_output=True, text=True, timeout=_LONGEST_S, check=False
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            raise PrintError(f"{Path(program).name}: {error}"[:_WORDS]) from error
        if not made.is_file() or not made.stat().st_size:
            said = (done.stderr.strip().splitlines() or ["it said nothing"])[-1]
            raise PrintError(f"{Path(program).name} printed nothing: {said}"[:_WORDS])
        made.replace(output)
