"""`imutui stop`."""

import typer

from imutui.cli.options import Json, Name


def command(name: Name = None, json: Json = False) -> None:
    """End the running acquisition and finish its file.

    Exit code 0, or 1 if something must be said of the recording: the verdict is RED, not every bias has converged, or
    the unit was silent.

    Example: imutui stop
    """
    from imutui.cli.exit_codes import say
    from imutui.logbook.json_text import dumps
    from imutui.session import client

    connection = client.attach(name)
    result = connection.stop("the command imutui stop")
    if json:
        print(dumps(result))
    elif result is None:
        say("stopped; nothing was being recorded")
    else:
        from imutui.cli.result_table import print_result

        print_result(result)
    # whoever finds nothing to stop need not wait for what follows an acquisition
    from imutui.cli.follow_acquisition import verdict

    raise typer.Exit(verdict(result, connection))
