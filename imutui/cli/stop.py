"""`imutui stop`."""

import typer

from imutui.cli.each_log import width
from imutui.cli.exit_codes import answer, say
from imutui.cli.options import Json, Name, OfBatch, acquisitions_of


def command(name: Name = None, batch: OfBatch = None, json: Json = False) -> None:
    """End the running acquisition, or those of a batch, and finish its file.

    Exit code 0, or 1 if something must be reported of the recording: the verdict is not GREEN, or the unit was silent.

    Example: imutui stop
    """
    from imutui.report import replay_text
    from imutui.session import client

    by = "the command imutui stop"
    if batch is not None:
        from imutui.cli.follow_batch import end_of, tell_ends
        from imutui.session.batch import each

        ended = each(acquisitions_of(name, batch), lambda one: one.stop(by))
        raise typer.Exit(tell_ends([end_of(one, outcome) for one, outcome in ended.items()], json=json))
    end = client.attach(name).stop(by)
    result = end["result"]
    if result is None and not json:
        say("stopped; nothing was being recorded")
    else:
        answer(result, lambda: replay_text.text(result, width()) if result else "", json=json)
    # whoever finds nothing to stop need not wait for what follows an acquisition
    from imutui.cli.follow_acquisition import verdict

    raise typer.Exit(verdict(end))
