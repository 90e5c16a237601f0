"""A recording in parts: when a file is full, and what the next one is called.

No packet is lost at the joint, and none is in two files. The filter begins anew with each file, so that a replay of any
one of them repeats its live result without the others; what effects remember of temperature is in the next file's
metadata, as are the file before it and the power-on that they are parts of.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from imutui.verdict import sources

if TYPE_CHECKING:
    from imutui.logbook.results import PartResult, ResultDocument

_MB = 1_000_000
_MIN_FILE_S = 1.0


@dataclass(slots=True)
class RecordingParts:
    """The files of one recording."""

    first: Path  # the first file
    # minutes, mb: after how much a file is full; 0 for never
    minutes: float
    mb: float
    number: int = 1  # of the present file, from 1
    # of each finished file: `log`, and `converged` and `passes`, which are true where no filter ran
    finished: "list[PartResult]" = field(default_factory=list)

    def is_full(self, seconds: float, size: int) -> bool:
        """Whether the present file has had its time or size; never before it is a second long.

        `seconds`: of the file, by a clock that nobody sets.
        `size`: bytes of it on the disk.
        """
        if seconds < _MIN_FILE_S:
            return False
        return 0.0 < self.minutes * 60.0 <= seconds or 0.0 < self.mb * _MB <= size

    def next_path(self) -> Path:
        """Name of the next file, which does not exist yet: that of the first, and which part it is."""
        stem = f"{self.first.stem}_p{self.number + 1}"
        path, number = self.first.with_name(f"{stem}{self.first.suffix}"), 2
        while path.exists():
            path, number = self.first.with_name(f"{stem}_{number}{self.first.suffix}"), number + 1
        return path

    def add_result(self, result: "ResultDocument") -> "ResultDocument":
        """Take the result of the present file; returned with all parts so far where there are several."""
        passes = sources.of_document(result).passes
        self.finished.append({"log": result["log"], "converged": result.get("converged", True), "passes": passes})
        if len(self.finished) > 1:
            result["parts"] = list(self.finished)
        return result
