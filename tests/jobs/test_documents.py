"""Documents of commands have the shapes that stand in `jobs.documents`, field by field."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, get_type_hints

import pytest
from helpers.paths import SAMPLE

from imutui.jobs import check, documents, info, operator_steps, recover
from imutui.logbook import reference_file
from imutui.logbook.results import NisFields, SdFields, StateFields


def fields(shape: Any) -> set[str]:
    """Names of a shape's fields."""
    names = {"StateFields": StateFields, "SdFields": SdFields, "NisFields": NisFields}
    return set(get_type_hints(shape, localns=names))


def cut(folder: Path) -> Path:
    """A log that ends in the middle, with damage before its end."""
    content = bytearray(SAMPLE.read_bytes()[:200_000])
    content[100_000] ^= 1
    path = folder / "cut.mcap"
    path.write_bytes(content)
    return path


@pytest.mark.parametrize("whole", [True, False])
def test_documents_have_the_fields_that_their_shapes_name(tmp_path: Path, whole: bool) -> None:
    path = SAMPLE if whole else cut(tmp_path)
    told = info.info(path)
    assert set(told) == fields(documents.InfoDocument)
    assert set(told["temperature_degc"] or {}) == {"first", "last", "min", "max"}
    assert all(set(topic) == fields(documents.TopicField) for topic in told["topics"].values())
    assert told["events"]
    assert all(set(event) == fields(documents.EventField) for event in (*told["events"], *told["marks"]))
    assert set(told["quality"]) <= fields(documents.QualityFields)
    checked = check.check(path)
    assert set(checked) == fields(documents.CheckDocument)
    assert bool(checked["findings"]) is not whole
    assert all(set(finding) == fields(documents.FindingField) for finding in checked["findings"])
    made = recover.recover(path, tmp_path / "made.mcap")
    assert set(made) == fields(documents.RecoverDocument)
    assert set(made["lost"]) == {"messages", "samples"}
    assert bool(made["damages"]) is not whole
    assert all(set(damage) == fields(documents.DamageField) for damage in made["damages"])


def test_a_guided_list_has_its_shape() -> None:
    offer = operator_steps.ready_made()[0]
    profile: Any = reference_file.parse(offer.file, offer.text.encode())
    told: Mapping[str, Any] = operator_steps.document(profile, offer.name)
    assert set(told) == {"version", "profile", "align", "duration_s", "segments"}
    assert all(set(segment) == {"number", "text", "seconds", "makes_testable"} for segment in told["segments"])
