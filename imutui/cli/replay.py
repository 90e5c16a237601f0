"""`imutui replay`."""

import sys
from pathlib import Path
from typing import Annotated, Any, Optional

import typer

from imutui.cli.options import End, Force, Json, Output, Reference, Start


def command(
    logs: Annotated[list[Path], typer.Argument(metavar="LOG...", help="Logs, finished or not.")],
    filter_name: Annotated[Optional[str], typer.Option("--filter", metavar="spkf", help="Filter.")] = None,  # noqa: UP045
    reference: Reference = None,
    set_: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Setting, such as filter.kappa=-12.")
    ] = None,
    start: Start = None,
    end: End = None,
    speed: Annotated[
        float | None, typer.Option("--speed", metavar="X", help="Times real time; as fast as it goes unless given.")
    ] = None,
    output: Output = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Run the filter over logs, headless, with the same steps as live.

    An unfinished log is read to its last flush (exit code 1).

    Example: imutui replay logs/*.mcap --json
    """
    from imutui.cli.outcome import FINDINGS, FINE, USAGE, fail, refuse_existing
    from imutui.cli.tables import print_result
    from imutui.jobs.replay import Options
    from imutui.logbook.results import dumps

    if output is not None:
        if len(logs) > 1:
            raise fail(USAGE, "-o takes the estimates of one log; name one log.")
        if output.exists() and logs[0].exists() and output.samefile(logs[0]):
            raise fail(USAGE, f"-o names the log itself, {logs[0]}; name another file.")
        refuse_existing(output, force)
    if speed is not None and not speed > 0.0:
        raise fail(USAGE, f"--speed is {speed:g}; it must be positive.")
    options = Options(start, end, _overrides(filter_name, reference, set_ or []), speed, output, force)
    documents = [_one(log, options) for log in logs]
    if json:
        print(dumps(documents if len(documents) > 1 else documents[0]))
    else:
        for document in documents:
            print_result(document)
    fine = all(d["converged"] and d["finished"] and "damage" not in d for d in documents)
    raise typer.Exit(FINE if fine else FINDINGS)


def _one(log: Path, options: Any) -> dict[str, Any]:
    from imutui.cli.outcome import say
    from imutui.jobs.replay import replay

    document = replay(log, options, _progress(log))
    if "damage" in document:
        say(f"imutui: {log}: {document['damage']}. Read up to {document['duration_s']:.1f} s; all before that is used.")
    for alarm in document["alarms"]:
        say(f"imutui: alarm: {alarm}")
    return document


def _overrides(filter_name: str | None, reference: str | None, pairs: list[str]) -> dict[str, Any]:
    from imutui.config import ConfigError, parse_pairs

    fields = {
        "filter.name": "filter",
        "filter.reference": "reference",
        "filter.measurements": "measurements",
        "filter.seed": "seed",
        "filter.kappa": "kappa",
        "site.gravity_mps2": "gravity_mps2",
    }
    values = parse_pairs(pairs)
    unusable = sorted(set(values) - set(fields))
    if unusable:
        raise ConfigError(
            f"--set {unusable[0]} cannot change a log that is already made; possible: {', '.join(fields)}"
        )
    overrides = {fields[key]: value for key, value in values.items()}
    if filter_name is not None:
        overrides["filter"] = filter_name
    if reference is not None:
        overrides["reference"] = reference
    return overrides


def _progress(log: Path) -> Any:
    if not sys.stderr.isatty():
        return lambda share: None

    def show(share: float) -> None:
        end = "\r\x1b[K" if share >= 1.0 else ""
        print(f"\r{log.name}: {share * 100:3.0f} %{end}", end="", file=sys.stderr, flush=True)

    return show
