"""Where the program begins: `imutui`, and `python -m imutui`.

Nothing is loaded before Ctrl+C has an answer, and each standard stream is open.
"""

# `signal` itself loads `enum` first, and is not ready for milliseconds
import _signal as signal  # type: ignore[import-not-found]
import os
import sys

INTERRUPTED = 130


def main() -> None:
    """Entry point of the `imutui` program."""
    # where a shell has put us into the background, its Ctrl+C is for others, and ignored from the start
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _interrupted)
    _open_streams()
    from imutui.cli import main as run

    run()


def _interrupted(*_: object) -> None:
    """End at once: until a command begins, which takes Ctrl+C itself, there is nothing to be left in order."""
    os.write(2, b"imutui: interrupted\n")
    os._exit(INTERRUPTED)


def _open_streams() -> None:
    """Put something in the place of streams that are closed (`>&-`), which the next file opened would take.

    Of the input there is nothing to be read, to the output nothing can be written, and messages are lost.
    """
    for name, flags, mode in (("stdin", os.O_RDONLY, "r"), ("stdout", os.O_RDONLY, "w"), ("stderr", os.O_WRONLY, "w")):
        if getattr(sys, name) is None:
            null = os.open(os.devnull, flags)
            setattr(sys, name, os.fdopen(null, mode, encoding="utf-8", errors="backslashreplace"))


if __name__ == "__main__":
    main()
