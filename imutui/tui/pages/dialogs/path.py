"""Asks for a path."""

from imutui.tui.pages.dialogs.base import FieldDialog


class PathDialog(FieldDialog):
    """Returns the path that was typed, None for Esc or nothing."""
