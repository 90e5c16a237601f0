"""`imutui stop`."""

from imutui.cli.options import Json, Name


def command(name: Name = None, json: Json = False) -> None:
    """End the running acquisition and finish its file.

    Example: imutui stop
    """
    from imutui.cli.exit_codes import say
    from imutui.logbook.json_text import dumps
    from imutui.session import client

    result = client.attach(name).stop()
    if json:
        print(dumps(result))
    elif result is None:
        say("stopped; nothing was being recorded")
    else:
        from imutui.cli.result_table import print_result

        print_result(result)
