"""The version of imutui's JSON documents, and a check that a document has this version and its declared type."""

from typing import Any

from imutui.declared import problem

VERSION = 1
"""Version of every JSON document that imutui writes and reads: results, rows, diaries, replies of an acquisition."""


def wrong_version(document: Any) -> str:
    """Return in words that a document is of another version; empty if it is of this one."""
    version = document.get("version") if isinstance(document, dict) else None
    if version == VERSION and type(version) is int:
        return ""
    return "it states no version" if version is None else f"its version is {version!r:.20}, not {VERSION}"


def fault(document: Any, shape: Any, where: str) -> str:
    """Return what keeps a document from being one of a kind, of this version; empty if nothing does.

    `shape`: typed dictionary of the kind.
    `where`: what the document is called.
    """
    if not isinstance(document, dict):
        return f"`{where}` is not an object"
    return wrong_version(document) or problem(document, shape, where)
