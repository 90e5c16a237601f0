"""What docs/ offers to users of other viewers fits the logs: layouts name what is in them, examples run and agree."""

import io
import json
import re
import runpy
import sys
from collections.abc import Iterator
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any
from unittest.mock import patch
from xml.etree import ElementTree

import pytest
from helpers import ros_messages
from helpers.paths import ROOT, SAMPLE
from rosbags.interfaces import Nodetype

from imutui.logbook import schemas

LAYOUTS = ROOT / "docs" / "viewers"
EXAMPLES = sorted((ROOT / "docs" / "examples").glob("*.py"))


def strings_in(tree: object) -> Iterator[str]:
    if isinstance(tree, str):
        yield tree
    elif isinstance(tree, list | dict):
        for part in tree.values() if isinstance(tree, dict) else tree:
            yield from strings_in(part)


def foxglove_paths() -> list[str]:
    """What the layout for Foxglove shows, as topic and fields by dots."""
    tree = json.loads((LAYOUTS / "foxglove.json").read_text())
    return [text for text in strings_in(tree["configById"]) if text.startswith("/")]


def plotjuggler_paths() -> list[str]:
    """What the layout for PlotJuggler shows, where a slash stands before fields too: as topic and fields by dots."""
    names = [curve.attrib["name"] for curve in ElementTree.parse(LAYOUTS / "plotjuggler.xml").iter("curve")]
    found = []
    for name in names:
        topic = next((topic for topic in schemas.TYPES if name.startswith(f"{topic}/")), name)
        found.append(topic + name.removeprefix(topic).replace("/", "."))
    return found


def is_shown(path: str) -> bool:
    """Whether a path is a topic of a log, or leads through its message to one number."""
    topic, *fields = path.split(".")
    if topic not in schemas.TYPES:
        return False
    kind, what = Nodetype.NAME, schemas.TYPES[topic]
    for field in fields:
        found = re.fullmatch(r"(\w+)(?:\[(\d+)\])?", field)
        if kind is not Nodetype.NAME or found is None:
            return False
        name, element = found.groups()
        kind, what = dict(ros_messages.typestore().get_msgdef(what).fields).get(name, (None, None))
        if kind is Nodetype.ARRAY and element is not None and int(element) < what[1]:
            kind, what = what[0]
    return not fields or (kind is Nodetype.BASE and what[0] == "float64")


@pytest.mark.parametrize("paths", [foxglove_paths, plotjuggler_paths])
def test_a_layout_shows_what_logs_have(paths: Any) -> None:
    found = paths()
    assert len(found) > 15
    assert [path for path in found if not is_shown(path)] == []


def test_a_wrong_path_is_found() -> None:
    wrong = ("/imu/data", "/imu/data_raw.angular_velocity.w", "/filter/estimate.gyro_bias_dps[3]")
    assert not any(map(is_shown, (*wrong, "/filter/estimate.gyro_bias_dps", "/imu/data_raw.header.frame_id")))


def test_each_panel_has_its_place() -> None:
    """Foxglove drops a panel that the layout names and does not describe, and shows none that it does not name."""
    tree = json.loads((LAYOUTS / "foxglove.json").read_text())
    assert sorted(text for text in strings_in(tree["layout"]) if "!" in text) == sorted(tree["configById"])


def output_of(example: Path) -> str:
    out = io.StringIO()
    with patch.object(sys, "argv", [str(example), str(SAMPLE)]), redirect_stdout(out):
        runpy.run_path(str(example), run_name="__main__")
    return out.getvalue()


def test_examples_of_reading_a_log_print_the_same() -> None:
    with_ours, with_rosbags = map(output_of, EXAMPLES)
    assert with_ours == with_rosbags
    assert with_ours.startswith("simulated, serial number")
    assert "520 samples" in with_ours
    assert float(with_ours.split()[-1]) == pytest.approx(-9.79, abs=0.2)
    assert "import imutui" not in EXAMPLES[1].read_text()
    page = (ROOT / "docs" / "viewers.md").read_text()
    assert all(f"```python\n{example.read_text()}```" in page for example in EXAMPLES)
