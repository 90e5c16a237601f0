"""Who may import whom; read from the syntax trees."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("imutui", "filters")

# package → what it may import of this project, besides itself
FLOORS = {
    "filters": set(),
    "imutui.instrument": {"filters.imu"},
    "imutui.logbook": {"filters"},
    "imutui.session": {"imutui.instrument", "imutui.logbook", "filters"},
    "imutui.jobs": {"filters", "imutui.logbook", "imutui.instrument.scaling"},
    "imutui.report": {"filters", "imutui.jobs"},
    "imutui.tui": {
        "imutui.session.client",
        "imutui.session.plan",
        "imutui.session.snapshot",
        "imutui.jobs",
        "imutui.report",
    },
    "imutui.config": {"filters"},
    "imutui.scenario": {"filters", "imutui.logbook.reference_file"},
    "imutui.cli": {"filters", "imutui"},
}

# library → the modules that may import it
DOORS = {
    "serial": {"imutui.instrument.port"},
    "mcap": {"imutui.logbook"},
    "rosbags": {"imutui.logbook"},
    "textual": {"imutui.tui"},
    "typer": {"imutui.cli"},
    "matplotlib": {"imutui.report"},
}


def modules() -> dict[str, Path]:
    found = {}
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            name = ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
            found[name] = path
    return found


MODULES = modules()


def imports(path: Path, *, top_level: bool = False) -> set[str]:
    """Absolute names of what a module imports; `from a import b` counts as a.b where that is a module."""
    tree = ast.parse(path.read_text())
    nodes = tree.body if top_level else list(ast.walk(tree))
    names = set()
    for node in nodes:
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            assert node.module is not None
            for alias in node.names:
                full = f"{node.module}.{alias.name}"
                names.add(full if full in MODULES else node.module)
    return names


def within(name: str, package: str) -> bool:
    return name == package or name.startswith(package + ".")


@pytest.mark.parametrize("module", MODULES)
def test_a_module_imports_only_from_the_floors_below(module: str) -> None:
    """No floor reaches up, so that filters stand alone and a replay never loads a terminal."""
    floor = max((f for f in FLOORS if within(module, f)), key=len, default=None)
    if floor is None:
        return
    for name in imports(MODULES[module]):
        if any(within(name, package) for package in PACKAGES) and name != "imutui":
            allowed = FLOORS[floor] | {floor}
            assert any(within(name, a) for a in allowed), f"{module} imports {name}"


@pytest.mark.parametrize("module", MODULES)
def test_each_library_has_one_door(module: str) -> None:
    """A library is imported where its door is and nowhere else."""
    for name in imports(MODULES[module]):
        for library, doors in DOORS.items():
            if within(name, library):
                assert any(within(module, door) for door in doors), f"{module} imports {name}"


def test_there_are_no_import_cycles() -> None:
    """Modules can be read one after the other."""
    graph = {
        name: {i for i in imports(path) if i in MODULES and i != name and not within(name, i)}
        for name, path in MODULES.items()
    }
    done: set[str] = set()

    def visit(name: str, trail: tuple[str, ...]) -> None:
        assert name not in trail, f"cycle: {' → '.join((*trail, name))}"
        if name in done:
            return
        for below in sorted(graph[name]):
            visit(below, (*trail, name))
        done.add(name)

    for name in graph:
        visit(name, ())


@pytest.mark.parametrize("module", [m for m in MODULES if within(m, "imutui.cli")])
def test_a_command_imports_what_is_heavy_when_it_runs(module: str) -> None:
    """Help is instant: no command loads numpy, textual, mcap or a filter at the top of its module."""
    if module in ("imutui.cli.virtual_readings", "imutui.cli.follow_acquisition", "imutui.cli.session_options"):
        return  # helpers that commands import when they run
    heavy = {n for n in imports(MODULES[module], top_level=True) if within(n, "filters") or within(n, "imutui")}
    heavy = {
        n
        for n in heavy
        if not within(n, "imutui.cli") or n.rsplit(".", 1)[-1] in ("virtual_readings", "follow_acquisition")
    }
    assert not heavy, f"{module} imports {sorted(heavy)} at its top"
