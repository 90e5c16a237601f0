"""`imutui replay`."""

import math
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from imutui.cli.each_log import progress, width
from imutui.cli.exit_codes import (
    FINDINGS,
    FINE,
    USAGE,
    answer,
    check_output,
    fail,
    in_words,
    say,
    say_if_not_kept,
    show_progress,
)
from imutui.cli.options import (
    Effects,
    End,
    FilterName,
    Force,
    Json,
    Output,
    ReadAs,
    Reference,
    Set,
    Start,
    effects_of,
    overrides_of,
    reference_of,
    say_assumed,
    states_reading,
)

if TYPE_CHECKING:
    from imutui.logbook.reading import Reading
    from imutui.logbook.results import ResultDocument


@states_reading
def command(
    read_as: ReadAs,
    logs: Annotated[list[Path], typer.Argument(metavar="LOG...", help="Logs, finished or not.")],
    filter_name: FilterName = None,
    reference: Reference = None,
    effects: Effects = None,
    set_: Set = None,
    start: Start = None,
    end: End = None,
    speed: Annotated[
        float | None, typer.Option("--speed", metavar="X", help="Times real time; as fast as it goes unless given.")
    ] = None,
    output: Output = None,
    estimates: Annotated[
        float, typer.Option("--estimates", metavar="HZ", help="Estimates a second in the output; 0 for all.")
    ] = 1.0,
    force: Force = False,
    json: Json = False,
) -> None:
    """Run the filter over logs, headless, with the same steps as live.

    Several logs are run side by side. An unfinished log is read to its last flush (exit code 1).

    Example: imutui replay logs/*.mcap --json
    """
    from imutui import config
    from imutui.jobs.replay import EstimatesFile
    from imutui.report import replay_text
    from imutui.verdict import sources

    if output is not None:
        if len(logs) > 1:
            raise fail(USAGE, "-o takes the estimates of one log; name one log.")
        check_output(output, force, *logs)
    if speed is not None and not speed > 0.0:
        raise fail(USAGE, f"--speed is {speed:g}; it must be positive.")
    if not 0.0 <= estimates < math.inf:
        raise fail(USAGE, f"--estimates is {estimates:g}; it must be 0 (all) or more a second.")
    file, name = reference_of(reference)
    overrides = overrides_of(filter_name, name, set_ or [])
    mode = config.load().file_mode
    reading = read_as(
        start=start,
        end=end,
        overrides=overrides,
        reference=file,
        effects=effects_of(effects),
    )
    written = None if output is None else EstimatesFile(output, estimates, force, mode)
    wanted = {"speed": speed, "output": written}
    say_if_not_kept()
    documents, code = [], FINE
    for log, outcome in zip(logs, _outcomes(logs, reading, wanted), strict=True):
        if isinstance(outcome, tuple):
            say(f"imutui: {outcome[1]}")
            code = max(code, outcome[0])
        else:
            documents.append(outcome)
            _tell(log, outcome)
            fine = sources.of_document(outcome).passes and outcome["finished"] and outcome["damage"] is None
            code = max(code, FINE if fine else FINDINGS)
    if documents or (json and len(logs) > 1):
        told = map(partial(replay_text.text, width=width()), documents)
        answer(documents if len(logs) > 1 else documents[0], lambda: "\n".join(told), json=json)
    raise typer.Exit(code)


def _outcomes(logs: list[Path], reading: "Reading", wanted: dict[str, Any]) -> Iterator[Any]:
    """Result of each log in order, or its exit code and what went wrong: one log's trouble is not the others'."""
    if len(logs) == 1:
        yield _one(logs[0], reading, wanted, lambda share: progress(share, logs[0].name))
        return
    from filters.kalman import runner
    from imutui.jobs.parallel import each

    runner.warm_up(show_progress)  # once, or each process would compile the step for itself
    show_progress(f"0 of {len(logs)} logs")
    for number, outcome in enumerate(each(partial(_one, reading=reading, wanted=wanted), logs), 1):
        show_progress(f"{number} of {len(logs)} logs")
        yield outcome


def _one(log: Path, reading: "Reading", wanted: dict[str, Any], show: Any = None) -> Any:
    from imutui.jobs.replay import replay

    try:
        return replay(log, reading, show or (lambda share: None), show_progress if show else None, **wanted)
    except Exception as error:  # noqa: BLE001 - the same words that the command itself would end with
        return in_words(error)


def _tell(log: Path, document: "ResultDocument") -> None:
    say_assumed(log, document["assumed"])
    if document["damage"] is not None:
        upto = f"Read up to {document['duration_s']:.1f} s; all before that is used."
        from imutui.command_line import command as command_of

        recover = command_of("recover", log, "-o", "FIXED.mcap")
        cure = f"`{recover}` makes a whole file of what can be read."
        say(f"imutui: {log}: {document['damage']}. {upto} {cure}")
    if document["effects_of_other_unit"] is not None:
        say(f"imutui: warning: {log}: {document['effects_of_other_unit']}.")
    if "position" in document["unobservable"]:
        say(
            f"imutui: {log}: its reference knows the attitude only: attitude and gyro biases are estimated; position,"
            " velocity and accelerometer biases can't be, and are null"
        )
    for alarm in document["alarms"]:
        say(f"imutui: alarm: {alarm}")
    for sentence in document["confounded"]:
        say(f"imutui: cannot be told apart: {sentence}")
