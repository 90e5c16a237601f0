"""`imutui config`."""

from typing import TYPE_CHECKING, Annotated

import typer

from imutui.cli.exit_codes import answer, say
from imutui.cli.options import Json

if TYPE_CHECKING:
    from imutui.config import Config


def command(
    show: Annotated[bool, typer.Option("--show", help="Print every setting (the default).")] = True, json: Json = False
) -> None:
    """Print each effective setting with its source, and where files are looked for.

    Flags win over the environment (IMUTUI_PATHS_LOGS for paths.logs), ./imutui.toml, the user's file, and defaults.
    What is printed can be pasted into such a file.

    Example: imutui config --show
    """
    from imutui import config

    loaded = config.load()
    for warning in loaded.warnings:
        say(f"imutui: {warning}")
    if json or show:
        settings = {key: {"value": s.value, "source": s.source} for key, s in loaded.settings.items()}
        files = [{"path": str(file.path), "read": file.read} for file in loaded.files]
        answer(settings | {"files": files}, lambda: _text(loaded), json=json)


def _text(loaded: "Config") -> str:
    """Settings as TOML, in columns, each with its source and what else it may be."""
    from imutui.declared import in_words
    from imutui.settings import SETTINGS

    lines = ["# looked for, the last one wins; then the environment, then flags:"]
    lines += [f"#   {file.path} ({'read' if file.read else 'not there'})" for file in loaded.files]
    shown = {key: _shown(setting.value) for key, setting in loaded.settings.items()}
    wide, wider = max(map(len, shown)) + 1, max(map(len, shown.values()))
    section = ""
    for key, value in shown.items():
        if key.split(".")[0] != section:
            section = key.split(".")[0]
            lines.append("")
        allowed = SETTINGS[key].allowed
        choice = f"; one of {in_words(allowed)}" if allowed else ""
        mark = "#" if loaded.settings[key].value is None else ""  # TOML has no word for it
        lines.append(f"{mark + key:<{wide}} = {value:<{min(wider, 24)}}  # {loaded.settings[key].source}{choice}")
    return "\n".join(lines)


def _shown(value: object) -> str:
    from imutui import toml_text

    return "as the unit has it" if value is None else toml_text.value(value)
