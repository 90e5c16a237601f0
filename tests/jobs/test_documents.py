"""Documents of commands have the shapes that stand in `jobs.documents`, field by field."""

from pathlib import Path
from typing import Any

import pytest
from helpers.paths import SAMPLE

from imutui import declared
from imutui.jobs import check, documents, info, recover
from imutui.logbook import results


def cut(folder: Path) -> Path:
    """A log that ends in the middle, with damage before its end."""
    content = bytearray(SAMPLE.read_bytes()[:200_000])
    content[100_000] ^= 1
    path = folder / "cut.mcap"
    path.write_bytes(content)
    return path


@pytest.mark.parametrize("whole", [True, False])
def test_documents_have_their_shapes_to_the_last_field(
    tmp_path: Path, whole: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("StateFields", "SdFields", "NisFields"):  # which a list of logs does without
        monkeypatch.setattr(documents, name, getattr(results, name), raising=False)
    path = SAMPLE if whole else cut(tmp_path)
    told, checked, made = info.info(path), check.check(path), recover.recover(path, tmp_path / "made.mcap")
    made_of: list[tuple[Any, Any]] = [
        (told, documents.InfoDocument), (checked, documents.CheckDocument), (made, documents.RecoverDocument)
    ]  # fmt: skip
    for document, shape in made_of:
        assert declared.problem(document, shape, "document", exact=True) == ""
    assert told["events"]
    assert set(told["temperature_degc"] or {}) == {"first", "last", "min", "max"}
    assert set(made["lost"]) == {"messages", "samples"}
    assert bool(checked["findings"]) is bool(made["damages"]) is not whole
