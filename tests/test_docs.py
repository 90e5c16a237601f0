"""README, CONTRIBUTING and the pages in docs/ are true as far as a machine can tell."""

import importlib.util
import re
import shlex
import tomllib
import unicodedata
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from urllib.parse import unquote

import pytest

from filters.effects.catalogue import EFFECTS
from imutui import batch_file, config, scenario
from imutui.cli import COMMANDS
from imutui.logbook import effects_file, schemas
from imutui.settings import SETTINGS
from imutui.tui.pages.base import PAGES, RACK

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
README = (ROOT / "README.md").read_text()
PAGE_FILES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(DOCS.glob("*.md"))]
TEXTS = {path.relative_to(ROOT).as_posix(): path.read_text() for path in PAGE_FILES}
ALL = "\n".join(TEXTS.values())
TREES = ("filters", "imutui", "tests", "benchmarks", "docs", "logs")


def generator() -> ModuleType:
    """The script docs/generate.py as a module."""
    spec = importlib.util.spec_from_file_location("docs_generate", DOCS / "generate.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def blocks(text: str, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", text, flags=re.DOTALL | re.MULTILINE)


def prose(text: str) -> str:
    """A page without its fenced blocks."""
    return re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE)


def commands_in(text: str) -> Iterator[list[str]]:
    """Every `imutui …` that a page tells its reader to type, as words."""
    lines = [line for block in blocks(text, "sh") for line in block.splitlines()]
    lines += re.findall(r"^    (imutui .*)$", prose(text), flags=re.MULTILINE)
    lines += re.findall(r"`(imutui [^`]+)`", re.sub(r"\s*\n\s*", " ", prose(text)))
    for line in lines:
        for part in re.split(r"&&|;|\bdo\b|(?<!\d)>|&", line.partition("    #")[0]):
            if part.strip().startswith("imutui "):
                yield shlex.split(part, comments=True)[1:]


def anchors(text: str) -> set[str]:
    """What a link into a page may name: its headings, as code hosts and mkdocs make anchors of them."""
    found = set()
    for heading in re.findall(r"^#+ (.*)$", prose(text), flags=re.MULTILINE):
        plain = heading.replace("`", "").strip().lower()
        host = re.sub(r"[^\w\- ]", "", plain).replace(" ", "-")
        ascii_only = unicodedata.normalize("NFKD", plain).encode("ascii", "ignore").decode()
        site = re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", ascii_only).strip())
        assert host == site, f'"{heading}" has one anchor on a code host ({host}) and another on the site ({site})'
        found.add(host)
    return found


def test_the_readme_is_short() -> None:
    """One screenful of why, two commands, the job in five steps; the rest has pages."""
    assert len(README.splitlines()) <= 150


def test_the_two_set_up_commands_stand_there() -> None:
    assert "    pip install . && imutui demo\n" in README
    assert "    pip install '.[test]' && pytest\n" in README
    assert "pip install '.[test]' && pytest" in (ROOT / ".ci" / "run").read_text()


@pytest.mark.parametrize("name", ["effects.md", "commands.md"])
def test_generated_pages_are_current(name: str) -> None:
    """`python docs/generate.py` would change nothing."""
    assert (DOCS / name).read_text() == generator().PAGES[name](), f"run `python docs/generate.py`: {name} is old"


def test_every_effect_has_its_notes_and_nothing_else_has() -> None:
    notes = tomllib.loads((DOCS / "effects_notes.toml").read_text())
    assert list(notes) == list(EFFECTS)
    for name, note in notes.items():
        assert {"shows", "separates"} <= set(note) <= {"title", "shows", "separates", "filter"}, name
        assert all(text.endswith(".") for key, text in note.items() if key != "title"), name
        named = set(re.findall(r"`(\w+)`", " ".join(note.values())))
        assert named <= set(EFFECTS), f"{name}: {named - set(EFFECTS)} is no effect"


def test_every_command_is_in_the_readme() -> None:
    for command in COMMANDS:
        assert re.search(rf"imutui {command}\b", README), command


@pytest.mark.parametrize("page", TEXTS)
def test_every_command_line_can_be_typed(page: str) -> None:
    flags = generator().flags
    for words in commands_in(TEXTS[page]):
        if words[0].startswith("-"):
            assert words[0] in ("--version", "--help"), words
            continue
        if words[0].isupper():
            continue  # `imutui COMMAND`
        assert words[0] in COMMANDS, f"{page}: imutui {' '.join(words)}"
        given = {word.partition("=")[0] for word in words[1:] if re.match(r"--?[a-z]", word)}
        assert given <= flags(words[0]), f"{page}: imutui {' '.join(words)}"


def test_options_named_in_the_text_exist() -> None:
    known = set().union(*(generator().flags(name) for name in COMMANDS)) | {"--version", "--snapshot-update"}
    for page, text in TEXTS.items():
        named = set(re.findall(r"`(--[a-z][a-z-]*)", text))
        assert named <= known, f"{page}: {named - known}"


def test_every_topic_is_told_with_its_type() -> None:
    for topic, kind in schemas.TYPES.items():
        assert f"| `{topic}` | `{kind}` |" in TEXTS["docs/formats.md"], topic


def test_every_page_of_the_screen_is_told() -> None:
    for key, title in [RACK, *PAGES]:
        assert f"## {key} {title}\n" in TEXTS["docs/screen.md"]
        assert f"| {key} {title} |" in TEXTS["docs/screen.md"]


def test_settings_named_anywhere_are_settings() -> None:
    sections = {key.partition(".")[0] for key in SETTINGS}
    named = set(re.findall(rf"`(?:--set )?((?:{'|'.join(sections)})\.[a-z_0-9]+)[=`]", ALL))
    named |= set(re.findall(rf"--set ((?:{'|'.join(sections)})\.[a-z_0-9]+)=", ALL))
    assert named
    assert named <= set(SETTINGS), named - set(SETTINGS)
    variables = {"IMUTUI_" + key.upper().replace(".", "_") for key in SETTINGS}
    assert set(re.findall(r"\bIMUTUI_[A-Z0-9_]+\b", ALL)) <= variables


def example(kind: str) -> Iterator[tuple[str, str]]:
    """TOML examples whose first line says what they are: the name of their file, and the text."""
    for text in TEXTS.values():
        for block in blocks(text, "toml"):
            words = block.splitlines()[0].removeprefix("# ").split(": ")
            if words[0] == kind:
                yield (words[1] if len(words) > 1 else f"{kind}.toml"), block


def test_every_toml_example_says_what_it_is() -> None:
    """So that each is read by what reads such files."""
    kinds = {b.splitlines()[0].removeprefix("# ").split(":")[0] for t in TEXTS.values() for b in blocks(t, "toml")}
    assert kinds == {"batch", "profile", "scenario", "effects", "configuration"}


def test_examples_of_profiles_and_scenarios_can_be_read(tmp_path: Path) -> None:
    """They are files as a reader would type them."""
    for name, text in example("profile"):
        (tmp_path / name).write_text(text)
        assert scenario.load_profile(tmp_path / name).segments
        (tmp_path / "table.toml").write_text(text)
    for name, text in example("scenario"):
        (tmp_path / name).write_text(text)
        assert scenario.load_scenario(tmp_path / name)


def test_the_example_of_an_effects_file_can_be_read(tmp_path: Path) -> None:
    ((name, text),) = example("effects")
    (tmp_path / name).write_text(text)
    document = effects_file.parse(effects_file.from_file(tmp_path / name))
    assert [effect.effect for effect in document.effects] == ["thermal_lag"]


def test_the_example_of_a_batch_can_be_read(tmp_path: Path) -> None:
    ((name, text),) = example("batch")
    (tmp_path / name).write_text(text)
    assert [unit.name for unit in batch_file.read(tmp_path / name).units] == ["9911750", "left"]


def test_the_example_of_a_configuration_can_be_read(home: Path) -> None:
    ((_, text),) = example("configuration")
    (home / config.FILE).write_text(text)
    loaded = config.load({}, home)
    assert not loaded.warnings
    assert {key for key, setting in loaded.settings.items() if str(home) in setting.source} >= {"paths.logs"}


def test_files_and_folders_named_in_the_pages_exist() -> None:
    for page, text in TEXTS.items():
        for path in re.findall(rf"`((?:{'|'.join(TREES)})/[\w./]*)`", text):
            if "NAME" not in path and not path.endswith(".mcap") and path != "docs/":
                assert (ROOT / path).exists(), f"{page}: {path}"
        for path in re.findall(rf"(?<![\w/])((?:{'|'.join(TREES)})/[\w./]*\.(?:py|toml|json|md|yml))\b", text):
            assert "NAME" in path or (ROOT / path).is_file(), f"{page}: {path}"


def test_tables_to_register_in_are_where_the_pages_say() -> None:
    """Whoever adds something finds the table that names it."""
    named = re.findall(r"`([A-Z]{4,})`(?: of| \()\s*`?([\w/]+\.py)", TEXTS["docs/architecture.md"])
    tables = {
        "INSTRUMENTS",
        "FILTERS",
        "ENGINES",
        "EFFECTS",
        "PAGES",
        "COMMANDS",
        "UNITS",
        "CASES",
        "EQUATIONS",
        "MEMBERS",
    }
    assert {table for table, _ in named} == tables
    for table, path in named:
        assert re.search(rf"^{table}\b", (ROOT / path).read_text(), flags=re.MULTILINE), f"{table} in {path}"


@pytest.mark.parametrize("page", TEXTS)
def test_links_lead_somewhere(page: str) -> None:
    for target in re.findall(r"\]\(([^)\s]+)\)", prose(TEXTS[page])):
        if re.match(r"https?:", target):
            continue
        name, _, anchor = unquote(target).partition("#")
        path = (ROOT / page).parent / name if name else ROOT / page
        assert path.is_file(), f"{page}: {target}"
        if anchor:
            assert anchor in anchors(path.read_text()), f"{page}: {target}"


def test_every_page_is_in_the_site_and_in_the_readme() -> None:
    """No page is written that nobody is led to."""
    site = (ROOT / "mkdocs.yml").read_text()
    for path in DOCS.glob("*.md"):
        assert re.search(rf": {path.name}$", site, flags=re.MULTILINE), path.name
        assert f"](docs/{path.name})" in README, path.name


def test_the_library_example_runs(capsys: pytest.CaptureFixture[str]) -> None:
    (code,) = blocks(TEXTS["docs/filter.md"], "python")
    names: dict[str, object] = {}
    exec(code, names)
    rows = capsys.readouterr().out.splitlines()
    assert len(rows) == 7
    assert rows[-1].endswith("True []")
    bias = [re.findall(r"-?\d+\.\d+", row)[:3] for row in (rows[-2].split("s", 1)[1], rows[-1])]
    assert all(abs(float(a) - float(b)) < 0.05 for a, b in zip(*bias, strict=True))


def test_the_recording_that_the_guide_makes_can_be_imported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from imutui.logbook.importing import recording

    (code,) = blocks(TEXTS["docs/guide.md"], "python")
    monkeypatch.chdir(tmp_path)
    exec(code, {})
    assert recording.load(tmp_path / "still.npz").samples == 1200


def test_the_site_builds(tmp_path: Path) -> None:
    """`mkdocs build` finds every link, anchor and page in order. Skipped without the extra `docs`."""
    pytest.importorskip("mkdocs")
    from mkdocs.commands.build import build
    from mkdocs.config import load_config

    build(load_config(str(ROOT / "mkdocs.yml"), site_dir=str(tmp_path)))
    assert "Set up" in (tmp_path / "index.html").read_text()
