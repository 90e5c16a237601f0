"""Options that several commands share."""

import functools
import inspect
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeAlias

import typer

from imutui.cli.exit_codes import FINE, USAGE, fail, say, tell

if TYPE_CHECKING:
    from collections.abc import Sequence
    from typing import Any

    from imutui.logbook.reading import Reading
    from imutui.logbook.reference_file import ReferenceFile
    from imutui.logbook.session_info import Overrides
    from imutui.session.client import Client

Json = Annotated[bool, typer.Option("--json", help="Print one JSON document on stdout.")]
Force = Annotated[bool, typer.Option("--force", help="Replace an existing file.")]
Name = Annotated[str | None, typer.Option("--name", help="Name of the acquisition, if several run.")]
OfBatch = Annotated[
    str | None,
    typer.Option("--batch", metavar="NAME", help="All units of a batch; with --name those, with commas between them."),
]
Reference = Annotated[
    str | None,
    typer.Option(
        "--reference",
        metavar="level|gravity|turned|FILE|NAME",
        help="What is known of the motion: level on north-east-down, still, turned by hand between rests, a file"
        " (table profile, trajectory), or a ready-made profile's name, which `imutui profile` lists.",
    ),
]
Effects = Annotated[
    str | None,
    typer.Option(
        "--effects", metavar="FILE|none", help="Effects that join the filter: a file that `imutui trace -o` wrote."
    ),
]
FilterName = Annotated[str | None, typer.Option("--filter", metavar="spkf|spkf-paper|ekf", help="Filter.")]
Set = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Setting, such as filter.kappa=-12 or filter.noise=log."),
]
Topic = Annotated[
    str | None,
    typer.Option(
        "--topic", metavar="NAME[,NAME]", help="Samples' topic in another program's log; two: rates, then forces."
    ),
]
StampsOf = Annotated[
    str | None,
    typer.Option(
        "--stamps",
        metavar="header|log|arrival",
        help="Times of the samples in another program's log; arrival: instants fitted under the log times.",
    ),
]
SiteText = Annotated[str | None, typer.Option("--site", metavar="LAT,LON,H", help="Site in degrees and metres.")]
Limits = Annotated[
    str,
    typer.Option(
        "--limits",
        metavar="AXIS=RATE/ACCEL[/LOW/HIGH],...",
        help="What axes may do, deg/s, deg/s^2, deg; narrower than the controller says, or where it says nothing.",
    ),
]
YesMove = Annotated[bool, typer.Option("--yes-move", help="The table may move: ask no question on the terminal.")]
Start = Annotated[float | None, typer.Option("--start", metavar="S", help="First second to take.")]
End = Annotated[float | None, typer.Option("--end", metavar="S", help="Last second to take.")]
Output = Annotated[Path | None, typer.Option("-o", "--output", help="File to write.")]


def refuse_unasked(*, yes_move: bool) -> None:
    """Raise the exit if there is neither --yes-move nor a terminal to ask on."""
    if not yes_move and not sys.stdin.isatty():
        raise fail(USAGE, "the table would move by itself. When nobody is near it, say so: --yes-move.")


def ask_to_move(url: str, how: str, *, yes_move: bool) -> None:
    """Ask the user on the terminal whether a table may move, unless --yes-move says so; raises the exit if not.

    `how`: it will move, in words.
    """
    refuse_unasked(yes_move=yes_move)
    if yes_move:
        return
    say(f"The table at {url} WILL MOVE by itself, {how}.\nIs everybody clear of it, and may it move? Type yes:")
    if sys.stdin.readline().strip().lower() != "yes":
        raise fail(USAGE, "the table does not move, and nothing was recorded.")


def acquisitions_of(name: str | None, batch: str | None) -> list[str]:
    """Names of the acquisitions that --name and --batch choose.

    Raises SessionError if none of that name runs, or several run and none is named.
    """
    from imutui.session import client
    from imutui.session.batch import acquisition_of, names

    if batch is None:
        return [client.attach(name).name]
    running = names(batch)
    return running if name is None else [acquisition_of(batch, unit) for unit in name.split(",")]


def ask_each(name: str | None, batch: str | None, do: "Callable[[Client], object]", said: str) -> None:
    """Have the chosen acquisitions do something, and end: `said`, with `{}` for its name, of each, or what is wrong."""
    from imutui.session.batch import each
    from imutui.session.client import SessionError

    chosen, code = acquisitions_of(name, batch), FINE
    for one, outcome in each(chosen, do).items():
        if not isinstance(outcome, SessionError):
            tell(said.replace("{}", one, 1))
        elif len(chosen) == 1:
            raise outcome
        else:
            say(f"imutui: {one}: {outcome}")
            code = max(code, outcome.exit_code)
    raise typer.Exit(code)


def reference_of(text: str | None) -> "tuple[ReferenceFile | None, str | None]":
    """File or ready-made profile that --reference names, if it names one, and the reference's kind."""
    if text is None:
        return None, None
    from imutui.logbook import import_reference

    file = import_reference.from_text(text)
    return file, text if file is None else file.kind


def effects_of(text: str | None) -> bytes | None:
    """Content of the file that --effects names; empty for "none", None if the option is not given."""
    if text is None:
        return None
    from imutui.logbook import effects_file

    return effects_file.NONE if text == "none" else effects_file.from_file(Path(text))


def overrides_of(filter_name: str | None, reference: str | None, pairs: list[str]) -> "Overrides":
    """What --filter, --reference and --set replace of a log's own settings.

    Raises InputError if --set names what a log that is made has for good, or there is no such filter.
    """
    from filters.errors import InputError
    from imutui.config import parse_pairs
    from imutui.settings import SETTINGS

    fields = {key: each.name for key, each in SETTINGS.items() if key.startswith("filter.")}
    fields["site.gravity_mps2"] = "gravity_mps2"
    values = parse_pairs(pairs)
    unusable = sorted(set(values) - set(fields))
    if unusable:
        raise InputError(f"--set {unusable[0]} cannot change a log that is already made; possible: {', '.join(fields)}")
    overrides: dict[str, str | float] = {fields[key]: value for key, value in values.items()}
    if "gravity_mps2" in overrides:
        overrides["site_stated"] = True
    if filter_name is not None:
        known = SETTINGS["filter.name"].allowed
        if filter_name not in known:
            raise InputError(f'--filter is "{filter_name}", not one of: {", ".join(map(str, known))}')
        overrides["filter"] = filter_name
    if reference is not None:
        overrides["reference"] = reference
    return overrides


Flags: TypeAlias = "dict[str, Any]"
"""Values of settings that a command line states, by their keys."""


def takes_settings(*keys: str) -> "Callable[[Callable[..., None]], Callable[..., None]]":
    """Return a decorator that gives a command the options of settings; of all that have one, if no keys are given.

    The command's parameter `flags` has the values that were given, by the settings' keys.
    """
    from imutui.settings import SETTINGS

    chosen = keys or sorted(SETTINGS, key=lambda key: key.partition(".")[0])
    names = {SETTINGS[key].name: key for key in chosen if SETTINGS[key].setting.flag}

    def gathered(given: Flags) -> Flags:
        return {names[name]: value for name, value in given.items() if value is not None}

    return functools.partial(_with_options, "flags", {name: option_of(key) for name, key in names.items()}, gathered)


def option_of(key: str) -> "Any":
    """Return the type of a command's parameter that is the option of a setting."""
    from imutui.settings import SETTINGS

    kind, setting = SETTINGS[key].kind, SETTINGS[key].setting
    option: Any = typer.Option(setting.flag, metavar=setting.metavar, help=setting.help)
    return Annotated[kind | None, option]


ReadAs: TypeAlias = Callable[..., "Reading"]
"""Takes the further arguments of a `Reading` beside those that options state, and returns it."""


def states_reading(command: Callable[..., None]) -> Callable[..., None]:
    """Return a command with the options that state how a recording of another program is meant.

    The command's parameter `read_as` is a `ReadAs`.
    """
    options: Flags = {
        "topic": Topic, "stamps": StampsOf, "mount": option_of("instrument.mount"),
        "accel_sign": option_of("instrument.accel_sign"), "gyro_sign": option_of("instrument.gyro_sign"),
        "site": SiteText, "gravity": option_of("site.gravity_mps2"),
    }  # fmt: skip
    return _with_options("read_as", options, lambda stated: functools.partial(_reading_of, **stated), command)


def _with_options(
    parameter: str,
    options: Flags,
    gathered: "Callable[[Flags], Any]",
    command: Callable[..., None],
) -> Callable[..., None]:
    """Return a command with options in place of one of its parameters, which gets what is gathered from them."""

    @functools.wraps(command)
    def with_options(**given: "Any") -> None:
        stated = {name: given.pop(name) for name in options}
        command(**{parameter: gathered(stated)}, **given)

    signature, by_name = inspect.signature(command), inspect.Parameter.KEYWORD_ONLY
    parameters: list[inspect.Parameter] = []
    for name, own in signature.parameters.items():
        new = (inspect.Parameter(each, by_name, default=None, annotation=kind) for each, kind in options.items())
        parameters += new if name == parameter else [own.replace(kind=by_name)]
    # typer makes the options of these two
    vars(with_options)["__signature__"] = signature.replace(parameters=parameters)
    hints = {name: hint for name, hint in command.__annotations__.items() if name != parameter}
    with_options.__annotations__ = {**hints, **options}
    return with_options


def _reading_of(
    *,
    topic: str | None,
    stamps: str | None,
    mount: str | None,
    accel_sign: int | None,
    gyro_sign: str | None,
    site: str | None,
    gravity: float | None,
    **others: "Any",
) -> "Reading":
    """Return the reading that a command's options state; `others` are the further arguments of `Reading`.

    Raises InputError for an option that is none.
    """
    from filters.errors import InputError
    from imutui.logbook.reading import STAMPS, Reading
    from imutui.logbook.session_info import FOREIGN

    if stamps is not None and stamps not in STAMPS:
        raise InputError(f'--stamps is "{stamps}", not one of: {", ".join(STAMPS)}')
    stated = {"mount": mount, "accel_sign": accel_sign, "gyro_sign": gyro_sign}
    overrides = {name: value for name, value in stated.items() if value is not None}
    if site is not None or gravity is not None:
        placed = FOREIGN.placed(parse_site(site), gravity)
        overrides |= {name: getattr(placed, name) for name in _PLACED}
    FOREIGN.overridden(overrides).axes()
    topics = tuple(name.strip() for name in topic.split(",")) if topic else ()
    return Reading(**others, topics=topics, stamps=stamps or "").with_overrides(overrides)


_PLACED = ("latitude_deg", "longitude_deg", "height_m", "gravity_mps2", "site_stated")


def say_assumed(log: Path, assumed: "Sequence[str]") -> None:
    """Print in one line what was assumed of another program's log."""
    if assumed:
        say(f"imutui: {log}: {'; '.join(assumed)}")


def parse_site(text: str | None) -> tuple[float, float, float] | None:
    """Return latitude, longitude (degrees) and height (m) of --site; raises InputError if it does not read so."""
    from filters.errors import InputError
    from imutui.session.plan import parse_place

    try:
        return None if text is None else parse_place(text)
    except InputError as error:
        raise InputError(f"--site is {error}") from None
