"""The README is true as far as a machine can tell."""

import re
from pathlib import Path

import pytest

from imutui.cli import COMMANDS
from imutui.config import DEFAULTS
from imutui.logbook import schemas

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_is_in_the_readme(command: str) -> None:
    """A reader finds each command there is."""
    assert re.search(rf"imutui {command}\b", README)


def test_every_command_in_the_readme_exists() -> None:
    """Nothing is promised that does not run."""
    named = set(re.findall(r"(?:^|`)\s*imutui ([a-z]+)", README, flags=re.MULTILINE))
    assert named <= set(COMMANDS)


@pytest.mark.parametrize("topic", schemas.TYPES)
def test_every_topic_is_in_the_readme_with_its_type(topic: str) -> None:
    """The table of topics is the list that the recorder writes."""
    assert f"| `{topic}` | `{schemas.TYPES[topic]}` |" in README


def test_the_configuration_example_uses_known_keys() -> None:
    """Each key in the example is a setting."""
    section = ""
    for line in README[README.index("    [paths]") :].splitlines():
        if not line.startswith("    "):
            break
        if heading := re.match(r"\s+\[(\w+)\]", line):
            section = heading[1]
        elif key := re.match(r"\s+(\w+) =", line):
            assert f"{section}.{key[1]}" in DEFAULTS


def test_folders_named_in_the_readme_exist() -> None:
    """The map is of this tree."""
    for folder in re.findall(r"^\| `([a-z/]+/)` \|", README, flags=re.MULTILINE):
        assert (ROOT / folder).is_dir(), folder


def test_the_two_set_up_commands_stand_there() -> None:
    """They are what .ci/run does."""
    assert "    pip install . && imutui demo\n" in README
    assert "    pip install '.[test]' && pytest\n" in README
    assert "pip install '.[test]' && pytest" in (ROOT / ".ci" / "run").read_text()


def test_the_library_example_runs(capsys: pytest.CaptureFixture[str]) -> None:
    """The ten lines print six rows of estimates, converged and without alarms, near the truth."""
    (code,) = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)
    names: dict[str, object] = {}
    exec(code, names)
    rows = capsys.readouterr().out.splitlines()
    assert len(rows) == 7
    assert rows[-1].endswith("True []")
    bias = [re.findall(r"-?\d+\.\d+", row)[:3] for row in (rows[-2].split("s", 1)[1], rows[-1])]
    assert all(abs(float(a) - float(b)) < 0.05 for a, b in zip(*bias, strict=True))
