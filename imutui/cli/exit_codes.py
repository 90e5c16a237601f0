"""How a command ends: results on stdout, one paragraph of error on stderr, an exit code; never a traceback."""

import contextlib
import errno
import functools
import os
import shutil
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import ParamSpec, TypeAlias, TypeVar

import typer

FINE, FINDINGS, USAGE, UNREADABLE, INSTRUMENT, DISK, INTERRUPTED = 0, 1, 2, 3, 4, 5, 130

P = ParamSpec("P")
R = TypeVar("R")
Document: TypeAlias = Mapping[str, object] | Sequence[object] | None


def say(text: str) -> None:
    """Print a message on stderr; what it quotes from outside does nothing to the terminal, and is not endless.

    On a terminal its lines end at words.
    """
    from imutui.plain_text import MESSAGE_LIMIT, cut, visible

    show_progress("")
    said = visible(cut(text, MESSAGE_LIMIT))
    if sys.stderr.isatty():
        from imutui.report import wrapping

        said = wrapping.reflowed(said, shutil.get_terminal_size((80, 24)).columns)
    print(said, file=sys.stderr, flush=True)


def say_if_not_kept() -> None:
    """Print, for a command that compiles, that compiled code cannot be kept on disk, where that is so."""
    from imutui import compile_cache

    if sentence := compile_cache.warning():
        say(f"imutui: {sentence}")


def tell(text: str) -> None:
    """Print text for people on stdout; what it quotes from outside does nothing to the terminal."""
    from imutui.plain_text import visible

    show_progress("")
    print(in_signs(visible(text)))


def in_signs(text: str) -> str:
    """Text in signs that stdout takes: where it is not Unicode, ASCII stands for what the encoding may lack."""
    encoding = sys.stdout.encoding or "utf-8"
    if encoding.lower().startswith("utf"):
        return text
    from imutui.tui.terminal.glyphs import GLYPHS

    return GLYPHS["ascii"].text(text).encode(encoding, "replace").decode(encoding)


def answer(document: Document, text: Callable[[], str], *, json: bool) -> None:
    """Print what a command has found: the document where JSON is asked for, else its text for people."""
    if json:
        print_json(document)
    else:
        tell(text())


def print_json(document: Document) -> None:
    """Print a document on stdout."""
    from imutui.logbook.json_text import dumps

    show_progress("")
    print(dumps(document))


_shown = ""  # what `show_progress` has put into the line that the cursor is in


def show_progress(text: str) -> None:
    """Replace the line that the cursor is in, until something else is said; on a terminal only."""
    global _shown
    from imutui.plain_text import in_line

    if text != _shown and sys.stderr.isatty():
        print(f"\r\x1b[K{in_line(text)}", end="", file=sys.stderr, flush=True)
        _shown = text


def fail(code: int, message: str) -> typer.Exit:
    """Print an error; returns what to raise."""
    say(f"imutui: {message}")
    return typer.Exit(code)


def lacking(what: str, extra: str) -> typer.Exit:
    """Print that a library is not installed, and what to type; returns what to raise.

    `what`: what needs which library, in words.
    `extra`: of pyproject.toml, that has it.
    """
    from imutui.cli.installed_from import command_for

    how = f"Type this, then the same command again:\n\n    {command_for(extra)}\n"
    return fail(USAGE, f"{what}, which is not installed here. {how}")


def refuse_existing(path: Path, force: bool, other: str = "name another file with -o") -> None:
    """Raise the exit for a file that exists and may not be replaced; `other` is what else the user can do."""
    if path.is_dir():
        raise fail(USAGE, f"{path} is a folder; -o names a file.")
    if path.exists() and not path.is_file():
        raise fail(USAGE, f"{path} is a device or a pipe, which a file would take the place of; name a file.")
    if os.path.lexists(path) and not force:
        raise fail(USAGE, _exists(path, other))
    from imutui.logbook import file_lock

    file_lock.refuse_held(path)


def _exists(path: Path | str, other: str = "name another file with -o") -> str:
    return f"{path} exists and is left as it is. --force replaces it, or {other}."


def check_output(path: Path, force: bool, *inputs: Path) -> None:
    """Raise the exit for a file that -o names and that must not or can't be made; no folder is made unasked.

    `*inputs`: files that are read, none of which it may be.
    """
    for file in inputs:
        if path.exists() and file.exists() and path.samefile(file):
            raise fail(USAGE, f"-o names {file} itself, which stays as it is; name another file.")
    refuse_existing(path, force)
    # a log's checksum and notes lie beside it; a checksum of a log that is gone is worth nothing
    from imutui.logbook import added_notes, checksum_file

    if checksum_file.read_or_none(path) is None:
        refuse_existing(checksum_file.path_of(path), force)
    refuse_existing(added_notes.path_of(path), force)
    if not path.parent.exists():
        from imutui.command_line import joined

        made = joined("mkdir", "-p", path.parent)
        raise fail(USAGE, f"There is no folder {path.parent}, and -o makes none. Type: {made} and then the same again.")


def handled(command: Callable[P, R]) -> Callable[P, R]:
    """Give a command the exit codes and error messages that all have."""

    @functools.wraps(command)
    def wrapped(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            with _interruptible():
                try:
                    _refuse_line_breaks([*args, *kwargs.values()])
                    return command(*args, **kwargs)
                finally:
                    show_progress("")
                    flush()
        except (typer.Exit, typer.Abort):
            raise
        except (Exception, KeyboardInterrupt) as error:  # noqa: BLE001 - the last resort: words instead of a traceback
            raise typer.Exit(told(error)) from None

    return wrapped


def told(error: Exception | KeyboardInterrupt) -> int:
    """Say what has ended a command; returns its exit code."""
    if isinstance(error, BrokenPipeError):
        return FINE  # whoever read our output has had enough
    # amid the making of a class Python 3.11 has it be the cause of a RuntimeError
    if isinstance(error, KeyboardInterrupt) or isinstance(error.__cause__, KeyboardInterrupt):
        say("imutui: interrupted")
        return INTERRUPTED
    code, words = in_words(error)
    say(f"imutui: {words}")
    return code


@contextlib.contextmanager
def _interruptible() -> Iterator[None]:
    """Let Ctrl+C be an exception in this block, where there may be something to be left in order."""
    before = signal.getsignal(signal.SIGINT)
    if not callable(before) or threading.current_thread() is not threading.main_thread():
        yield
        return
    hook = sys.unraisablehook
    try:
        sys.unraisablehook = lambda told: _later() if told.exc_type is KeyboardInterrupt else hook(told)
        signal.signal(signal.SIGINT, signal.default_int_handler)
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        sys.unraisablehook = hook


def _later() -> None:
    """Let Ctrl+C come again: it came where Python drops exceptions, as at the end of the import of a module."""
    main = threading.main_thread().ident or 0
    threading.Timer(0.01, signal.pthread_kill, (main, signal.SIGINT)).start()


def _refuse_line_breaks(arguments: list[object]) -> None:
    """Refuse names of files that would put lines of their own among those that a command says."""
    for argument in arguments:
        for path in argument if isinstance(argument, list) else [argument]:
            if isinstance(path, Path) and len(str(path).splitlines()) > 1:
                from imutui.plain_text import in_line

                raise fail(USAGE, f"the name {in_line(str(path))} has a line break in it. Rename it, then ask again.")


def flush() -> None:
    """Write what is printed, here, where it can still be said what is wrong with it.

    The interpreter would try again as it exits, and complain in words of its own: what can't be written is let go.
    """
    try:
        sys.stdout.flush()
    except OSError as error:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        error.filename = _OUTPUT
        raise


_OUTPUT = "the standard output"


def in_words(error: Exception) -> tuple[int, str]:
    """Exit code of an error, and what to tell the user."""
    from filters.errors import InputError

    for code, names in _CODES.items():
        if any(_raised(name, error) for name in names):
            return getattr(error, "exit_code", code), _with_cures(error)
    if _raised("filters.kalman.spkf.DivergenceError", error):
        return FINDINGS, f"{error}. Look at the data around there, or replay a part with --start and --end."
    if isinstance(error, InputError):
        return USAGE, _with_cures(error)
    if isinstance(error, MemoryError):
        words = error or "memory ran out"
        return FINDINGS, f"{words}. Take fewer logs at a time, or a part with --start and --end."
    if isinstance(error, OSError) and error.filename == _OUTPUT and error.errno == errno.EBADF:
        return DISK, f"{_OUTPUT} is closed, and what is asked for goes there. `>/dev/null` throws it away."
    if isinstance(error, FileExistsError) and error.filename:
        return USAGE, _exists(error.filename)
    if isinstance(error, OSError):
        name = error.filename2 or error.filename
        where = f"{name}: " if name else ""
        return DISK, f"{where}{error.strerror or error}. Check the path, its permissions and the space left."
    from imutui import defects

    return FINDINGS, f"{defects.told(error)} Recordings are not affected."


def _with_cures(error: Exception) -> str:
    """Return what is wrong with an input, and the commands that take it."""
    from imutui.command_line import command

    cures = getattr(error, "cures", ())
    lines = [command(*((name,) if name else _without(flags[::2])), *flags) for name, flags in cures]
    said = str(error)
    return said if not lines else f"{said.rstrip('.')}. Type: " + ", or ".join(f"`{line}`" for line in lines)


def _without(options: Sequence[str]) -> list[str]:
    """Return the words of this command without some options and what follows them."""
    words = sys.argv[1:]
    return [word for before, word in zip(["", *words], words, strict=False) if not {before, word} & {*options}]


_CODES = {
    INSTRUMENT: (
        "imutui.origin_gate.AddressError",
        "imutui.session.client.SessionError",
        "imutui.jobs.campaign.cluster.ClusterError",
        "imutui.table.links.TableError",
    ),
    UNREADABLE: (
        "imutui.batch_file.BatchError",
        "imutui.logbook.reader.UnreadableLogError",
        "imutui.logbook.importing.table.ImportDataError",
        "imutui.scenario.ScenarioError",
        "imutui.cli.spoil.SpoilError",
    ),
}
"""Of errors whose message is all that is to be said; one that has an exit code of its own keeps it."""


def _raised(name: str, error: Exception) -> bool:
    """Whether an error is of a class; whoever raised it has loaded its module, so that asking loads nothing."""
    module, _, class_ = name.rpartition(".")
    loaded = sys.modules.get(module)
    return loaded is not None and isinstance(error, getattr(loaded, class_))


@contextlib.contextmanager
def handling(handlers: Mapping[signal.Signals, Callable[..., None]]) -> Iterator[None]:
    """Have signals handled by functions; the handlers before are put back at the end."""
    before = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
