"""What to type to add an extra to this very installation: by the program that installed it, from where it came."""

import importlib.metadata
import importlib.util
import json
import sys
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

NAME = "imutui"
SOURCE = Path(__file__).parents[2]


def command_for(extra: str) -> str:
    """A command of the shell that installs an extra beside the running program."""
    from imutui.command_line import joined

    try:
        distribution = importlib.metadata.distribution(NAME)
    except importlib.metadata.PackageNotFoundError:  # run from a source folder that nothing was installed from
        return joined(*_installer(), f"{SOURCE}[{extra}]")
    origin = json.loads(distribution.read_text("direct_url.json") or "{}")
    return joined(*_installer(), *_what(origin, extra, _needed(distribution, extra)))


def _installer() -> list[str]:
    """Whatever installs into the environment of this interpreter."""
    prefix = Path(sys.prefix)
    if (prefix / "pipx_metadata.json").exists():
        return ["pipx", "runpip", prefix.name, "install"]
    if importlib.util.find_spec("pip") is None:
        return ["uv", "pip", "install", "--python", sys.executable]
    return [sys.executable, "-m", "pip", "install"]


def _what(origin: dict[str, Any], extra: str, needed: list[str]) -> list[str]:
    """What is to be installed: the extra from the folder, file or repository that the program came from.

    `origin`: content of direct_url.json (PEP 610); empty if the program came from an index.
    `needed`: requirements of the extra, which do where the origin is gone.
    """
    url = str(origin.get("url", ""))
    if not origin:
        return [f"{NAME}[{extra}]"]
    if "vcs_info" in origin:
        commit = origin["vcs_info"].get("commit_id", "")
        return [f"{NAME}[{extra}] @ {origin['vcs_info']['vcs']}+{url}" + (f"@{commit}" if commit else "")]
    if url.startswith("file:"):
        path = Path(unquote(urlsplit(url).path))
        if not path.exists():
            return needed
        editable = origin.get("dir_info", {}).get("editable")
        return [*(["-e"] if editable else []), f"{path}[{extra}]"]
    return [f"{NAME}[{extra}] @ {url}"]


def _needed(distribution: importlib.metadata.Distribution, extra: str) -> list[str]:
    marked = (requirement.partition(";") for requirement in distribution.requires or [])
    return [what.strip() for what, _, marker in marked if marker.replace('"', "'").strip() == f"extra == '{extra}'"]
