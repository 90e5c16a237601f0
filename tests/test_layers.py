"""Who may import whom, what may cross a border, how large a class may be; read from the syntax trees.

The floors are those of docs/architecture.md. One test each: it lists everything that it finds, not only the first.
"""

import ast
import sys
from collections.abc import Iterator
from functools import cache

from helpers.modules import MODULES, PACKAGES, tree_of, within

GROUND = {
    f"filters.{name}"
    for name in (
        "errors",
        "types",
        "compilation",
        "channels",
        "first_order",
        "earth",
        "attitude",
        "specification",
        "imu",
        "allan",
        "state",
    )
}

EVERYWHERE = {"filters.errors"} | {
    f"imutui.{name}"
    for name in (
        "command_line",
        "declared",
        "defects",
        "document_shape",
        "estimate_history",
        "outside_file",
        "plain_text",
        "settings",
        "toml_text",
    )
}
"""What any module of imutui may import: they know the standard library, and numpy, and each other, only."""

# package or module → what it may import of this project, besides itself
FLOORS = {
    "imutui.command_line": set(),
    "imutui.estimate_history": set(),
    "imutui.plain_text": set(),
    "imutui.toml_text": set(),
    "imutui.outside_file": set(),
    "imutui.defects": set(),
    "imutui.declared": set(),
    "imutui.settings": {"filters.channels"},
    "imutui.document_shape": set(),
    "filters": GROUND,
    "filters.motion": GROUND,
    "filters.kalman": GROUND | {"filters.motion"},
    "filters.effects": GROUND | {"filters.motion"},
    "filters.health": GROUND | {"filters.effects"},
    "filters.simulation": GROUND | {"filters.motion", "filters.effects.inputs"},
    "filters.tracing": GROUND | {"filters.motion", "filters.kalman", "filters.effects", "filters.health.finding"},
    "filters.fleet": GROUND,
    "filters.multiposition": GROUND | {"filters.motion", "filters.effects", "filters.tracing", "filters.fleet"},
    "imutui.instrument": {"filters.imu"},
    "imutui.table": {"filters.channels", "filters.motion", "filters.simulation", "imutui.instrument"},
    "imutui.logbook": {"filters", "imutui.estimates"},
    "imutui.origin_gate": set(),
    "imutui.foxglove_server": {"imutui.logbook", "imutui.origin_gate"},
    "imutui.session": {
        "imutui.batch_file",
        "imutui.compile_cache",
        "imutui.estimates",
        "imutui.instrument",
        "imutui.logbook",
        "imutui.origin_gate",
        "imutui.table",
        "imutui.verdict",
        "filters",
    },
    "imutui.session.snapshot": {"imutui.estimates", "filters.health.finding"},
    "imutui.batch_file": {"filters.imu", "imutui.instrument.names"},
    "imutui.estimates": {"filters.channels", "filters.specification", "filters.tracing.trace_document"},
    "imutui.verdict": {
        "filters.channels",
        "filters.health.finding",
        "filters.effects.plain_names",
        "filters.specification",
        "imutui.estimates",
        "imutui.logbook.results",
    },
    "imutui.jobs": {"filters", "imutui.estimates", "imutui.logbook", "imutui.instrument.registry"},
    "imutui.jobs.campaign": {"filters", "imutui.estimates", "imutui.logbook", "imutui.jobs", "imutui.verdict"},
    "imutui.report": {
        "filters",
        "imutui.estimates",
        "imutui.jobs",
        "imutui.logbook.atomic_file",
        "imutui.logbook.json_text",
        "imutui.verdict",
    },
    "imutui.tui": {
        "filters.health.finding",
        "imutui.estimates",
        "imutui.batch_file",
        "imutui.session.batch",
        "imutui.session.client",
        "imutui.session.plan",
        "imutui.session.snapshot",
        "imutui.jobs",
        "imutui.report",
        "imutui.verdict",
    },
    "imutui.config": set(),
    "imutui.scenario": {"filters", "imutui.logbook"},
    "imutui.cli": {"filters", "imutui"},
}

# library → the packages or modules that may import it
DOORS = {
    "serial": {"imutui.instrument.port"},
    "pyvisa": {"imutui.table.links"},
    "mcap": {"imutui.logbook"},
    "rosbags": {"imutui.logbook"},
    "zstandard": {"imutui.logbook.mcap_format", "imutui.logbook.bag"},
    "lz4": {"imutui.logbook.mcap_format"},
    "textual": {"imutui.tui"},
    "typer": {"imutui.cli"},
    "matplotlib": {"imutui.report"},
    "foxglove": {"imutui.foxglove_server"},
    "pyarrow": {"imutui.logbook.parquet"},
    "pandas": {"imutui.logbook.importing.text"},
    "dask": {"imutui.jobs.campaign.cluster"},
    "distributed": {"imutui.jobs.campaign.cluster"},
    "numba": {"filters", "imutui.compile_cache"},
}

# what is said, and what is judged: pure functions, which a command may use as well as a page
WITHOUT_TEXTUAL = ("imutui.tui.messages", "imutui.tui.formatting")
TEXT_MODULES = ("text", "result_text", "explanation")

MOST_METHODS = 36


@cache
def statements(module: str) -> tuple[ast.AST, ...]:
    """What stands on lines of its own in a module, at every depth: expressions, which are most of a tree, do not."""
    found, waiting = [], list[ast.AST]([tree_of(module)])
    while waiting:
        node = waiting.pop()
        found.append(node)
        for part in ("body", "orelse", "finalbody", "handlers", "cases"):
            waiting += getattr(node, part, ())
    return tuple(found)


@cache
def imports(module: str, *, top_level: bool = False) -> frozenset[str]:
    """Absolute names of what a module imports; `from a import b` counts as a.b where that is a module."""
    nodes = tree_of(module).body if top_level else statements(module)
    names: set[str] = set()
    for node in nodes:
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{module}: relative import"
            assert node.module is not None
            for alias in node.names:
                full = f"{node.module}.{alias.name}"
                names.add(full if full in MODULES else node.module)
    return frozenset(names)


def floor_of(module: str) -> str | None:
    """The innermost package or module with a floor that a module belongs to."""
    return max((f for f in FLOORS if within(module, f)), key=len, default=None)


def test_a_module_imports_only_from_the_floors_below() -> None:
    """No floor reaches up, so that filters stand alone and a replay never loads a terminal."""
    wrong = []
    for module in MODULES:
        if (floor := floor_of(module)) is None:
            continue
        allowed = FLOORS[floor] if floor == "filters" else FLOORS[floor] | {floor}
        allowed = allowed if within(floor, "filters") else allowed | EVERYWHERE
        for name in imports(module):
            ours = any(within(name, package) for package in PACKAGES) and name not in PACKAGES
            if ours and not any(within(name, a) for a in allowed):
                wrong.append(f"{module} imports {name}")
    assert not wrong


def test_only_the_registry_leads_to_an_instruments_own_room() -> None:
    """Whoever acquires, and whatever instruments share, knows what an instrument is, and none of them."""
    rooms = {name for name, path in MODULES.items() if name.startswith(_INSTRUMENTS) and path.name == "__init__.py"}
    assert len(rooms) >= 2
    common = [m for m in MODULES if m.startswith(_INSTRUMENTS) and not any(within(m, room) for room in rooms)]
    acquiring = [m for m in MODULES if within(m, "imutui.session")]
    wrong = [
        f"{module} imports {name}"
        for module in {*common, *acquiring} - {f"{_INSTRUMENTS}registry"}
        for name in imports(module)
        if any(within(name, room) for room in rooms)
    ]
    assert not wrong


_INSTRUMENTS = "imutui.instrument."


def test_each_library_has_one_door() -> None:
    """A library is imported where its door is and nowhere else."""
    wrong = [
        f"{module} imports {name}"
        for module in MODULES
        for name in imports(module)
        for library, doors in DOORS.items()
        if within(name, library) and not any(within(module, door) for door in doors)
    ]
    assert not wrong


def test_there_are_no_import_cycles() -> None:
    graph = {name: {i for i in imports(name) if i in MODULES and i != name and not within(name, i)} for name in MODULES}
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


def test_the_snapshot_needs_the_standard_library_only() -> None:
    """To read a snapshot, nothing has to be installed but modules that need the standard library."""
    shapes = {"imutui.session.snapshot", *FLOORS["imutui.session.snapshot"], *FLOORS["imutui.estimates"]}
    needed = {name for module in shapes for name in imports(module)}
    assert (
        not {name.split(".")[0] for name in needed if not any(within(name, shape) for shape in shapes)}
        - sys.stdlib_module_names
    )


def test_text_and_verdicts_never_load_textual() -> None:
    text = [m for m in MODULES if within(m, "imutui.tui.pages") and m.rsplit(".", 1)[-1] in TEXT_MODULES]
    assert len(text) >= 5
    wrong = []
    for module in (*text, *WITHOUT_TEXTUAL):
        reached, waiting = set(), [module]
        while waiting:
            name = waiting.pop()
            reached.add(name)
            waiting += [i for i in imports(name) if i in MODULES and i not in reached and within(i, "imutui.tui")]
            wrong += [f"{module} reaches {i} by {name}" for i in imports(name) if within(i, "textual")]
    assert not wrong


def test_a_command_imports_what_is_heavy_when_it_runs() -> None:
    assert not imports("imutui.instrument.names")
    # helpers that commands import when they run
    names = (
        "virtual_readings",
        "virtual_table",
        "virtual_units",
        "played_recording",
        "spoil",
        "follow_acquisition",
        "follow_batch",
        "investigation_page",
        "session_options",
    )
    late = tuple(f"imutui.cli.{name}" for name in names)
    wrong = [
        f"{module} imports {name} at its top"
        for module in MODULES
        if within(module, "imutui.cli") and module not in late
        for name in imports(module, top_level=True)
        if any(within(name, package) for package in PACKAGES)
        and (name in late or not (within(name, "imutui.cli") or name == "imutui.instrument.names"))
    ]
    assert not wrong


def public_functions(module: str) -> Iterator[ast.FunctionDef | ast.AsyncFunctionDef]:
    """Functions and methods of a module that others may call."""
    for node in statements(module):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and not node.name.startswith("_"):
            yield node


def test_what_crosses_a_border_has_a_name_for_its_shape() -> None:
    wrong = []
    for module in MODULES:
        if any(within(module, edge) for edge in EDGES):
            continue
        for function in public_functions(module):
            arguments = [*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs]
            annotations = [a.annotation for a in arguments if a.annotation] + [function.returns or ast.Constant(None)]
            shapeless = [ast.unparse(a) for a in annotations if "[str, Any]" in ast.unparse(a)]
            wrong += [f"{module}.{function.name}: {annotation}" for annotation in shapeless]
    assert not wrong


EDGES: dict[str, str] = {
    "imutui.jobs.campaign.stored_rows": "a line of a journal is of any shape until it has been looked at",
    "imutui.declared": "what is read is of any shape until it has been read",
    "imutui.toml_text": "a document is of any shape until its reader has looked at it",
}
"""Modules where documents of any shape are read or written, and why."""


def test_a_class_is_small_enough_to_be_read() -> None:
    wrong = []
    for module in MODULES:
        for node in statements(module):
            if isinstance(node, ast.ClassDef):
                methods = sum(isinstance(n, ast.FunctionDef | ast.AsyncFunctionDef) for n in node.body)
                wrong += [f"{module}.{node.name}: {methods} methods"] if methods > MOST_METHODS else []
    assert not wrong
