"""The recordings that the logs page lists: of a folder, and files opened one by one. No widget."""

from collections.abc import Sequence
from pathlib import Path

from imutui.jobs import info
from imutui.jobs.info import Brief
from imutui.tui.pages.logs import text
from imutui.tui.pages.logs.text import WRITING


class Recordings:
    """What was found at the last look, and which of it is chosen for a trace."""

    def __init__(self) -> None:
        self.opened: Path | None = None  # the folder that somebody opened
        self.briefs: list[Brief] | None = None  # None before the first look
        self.chosen: set[Path] = set()
        self._extra: list[Path] = []

    def find(self, folder: Path) -> list[Brief]:
        """Files opened one by one and a folder's, newest first. Blocks, so it is called in a thread."""
        return info.newest_first([*(info.brief(path) for path in list(self._extra)), *info.recordings(folder)])

    def take(self, found: list[Brief]) -> None:
        """Take what was found; what is not there any more is not chosen either."""
        self.briefs = found
        self.chosen &= {brief.path for brief in found}

    def at(self, row: int | None) -> Brief | None:
        briefs = self.briefs or []
        return briefs[row] if row is not None and row < len(briefs) else None

    def row_of(self, path: Path | None) -> int | None:
        """Row of a recording; None if it is not in the list."""
        return next((row for row, brief in enumerate(self.briefs or []) if brief.path == path), None)

    def toggle(self, path: Path) -> None:
        self.chosen ^= {path}

    def chosen_in_order(self) -> Sequence[Path]:
        return text.order([brief for brief in self.briefs or [] if brief.path in self.chosen])

    def writing(self) -> set[Path]:
        """Files that are being written, by the names that results have for them."""
        return {p for b in self.briefs or [] if b.state == WRITING for p in (b.path, b.path.resolve())}

    def open_folder(self, folder: Path) -> None:
        """List a folder's from the next look on."""
        self.opened, self._extra, self.briefs = folder, [], None
        self.chosen.clear()

    def open_file(self, path: Path, folder: Path) -> None:
        """List a file as well, if it is not in the folder that is listed."""
        if path.parent != folder:
            self._extra = [path, *(other for other in self._extra if other != path)]
