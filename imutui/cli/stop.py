"""`imutui stop`."""

import typer

from imutui.cli.each_log import width
from imutui.cli.exit_codes import answer, say
from imutui.cli.options import Json, Name


def command(name: Name = None, json: Json = False) -> None:
    """End the running acquisition and finish its file.

    Exit code 0, or 1 if something must be said of the recording: the verdict is RED, not every bias has converged, or
    the unit was silent.

    Example: imutui stop
    """
    from imutui.report import replay_text
    from imutui.session import client

    connection = client.attach(name)
    result = connection.stop("the command imutui stop")
    if result is None and not json:
        say("stopped; nothing was being recorded")
    else:
        answer(result, lambda: replay_text.text(result, width()) if result else "", json=json)
    # whoever finds nothing to stop need not wait for what follows an acquisition
    from imutui.cli.follow_acquisition import verdict

    raise typer.Exit(verdict(result, connection))
