"""Do the tests notice when the product is changed? Draws mutations, finds the tests that reach them, and runs those.

    python benchmarks/mutations.py run before.json                 # at the commit that they are drawn from
    python benchmarks/mutations.py run after.json --commit HEAD    # the same ones, at another
    python benchmarks/mutations.py table before.json after.json    # exit code 1 if fewer are caught than before

A mutation is looked for at another commit by its function and statement, in whatever module they are there; one whose
code was deleted or rewritten is "gone". The tree is copied to `--work` with all mutations in it, each behind a switch
that also tells which test came by. So the whole suite runs once, and for each mutation only tests that reached it: the
fastest of every test file, at most 60 of them, and 240 s. A test that takes longer than a second and fails is run again
without the mutation, and does not count when it fails then too. Compiled code can't be switched: a mutation in there
has a copy of the tree, and a cache, of its own. `run` goes on where it was broken off.
"""

import argparse
import ast
import collections
import concurrent.futures
import contextlib
import itertools
import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
DRAWN_AT, NUMBER, SEED = "495ad3a", 200, 26
MOST_TESTS, MOST_S, TEST_S = 60, 240.0, 120
FATES = ("caught", "timed out", "survived", "unreached", "gone", "not told")
COMPILED = re.compile(r"(njit|compiled|inlined)\b")
SPARED = re.compile(r"\blog(ger|ging)?\.|_LOG|warnings\.|TYPE_CHECKING|__all__|__name__|Literal|super\(\)\.__init__")
Function = ast.FunctionDef | ast.AsyncFunctionDef
TURNED: dict[type[ast.AST], Any] = {
    ast.Lt: ast.GtE,
    ast.Gt: ast.LtE,
    ast.Eq: ast.NotEq,
    ast.In: ast.NotIn,
    ast.Is: ast.IsNot,
    ast.Add: ast.Sub,
}
TURNED |= {other: one for one, other in TURNED.items()}
Change = tuple[str, ast.expr | ast.stmt, str]  # kind, what is changed, text instead of it
SWITCH = "__import__('mutation_probe').on({})"
PROBE = """
import os
ON, LOG, SEEN = int(os.environ.get("PYTEST_MUTATION_ON", "-1")), os.environ.get("PYTEST_MUTATION_LOG"), set()

def on(number):
    test = os.environ.get("PYTEST_CURRENT_TEST")
    if LOG and test and (number, test) not in SEEN:
        SEEN.add((number, test))
        _say(number, test)
    return number == ON

def _say(*words):
    try:
        with open(LOG, "a") as file:
            file.write(" ".join(map(str, words)) + "\\n")
    except OSError:  # a test of full disks
        pass

def pytest_runtest_logreport(report):
    if "PYTEST_XDIST_WORKER" not in os.environ:
        _say(report.outcome, report.when, report.duration, report.nodeid)

def pytest_configure(config):
    for plugin in config.pluginmanager.get_plugins():  # the suite's has everything compiled; it is
        if "PYTEST_MUTATION_WARM" in os.environ and getattr(plugin, "__file__", "").endswith("tests/conftest.py"):
            config.hook.pytest_sessionstart._remove_plugin(plugin)
"""


@dataclass(frozen=True)
class Mutation:
    """A change of one node, known by its function, its statement, and which one in there it is."""

    module: str
    function: str  # qualified; that of a constant of a module is empty
    statement: str
    kind: str
    index: int  # among the same kind's in the statement
    becomes: str
    line: int
    span: tuple[int, int]  # bytes
    static: str = ""  # name that functions know it by, of what is computed as a module is imported

    @property
    def room(self) -> str:
        """Folder of `filters` or `imutui`."""
        return "/".join(Path(self.module).parts[:2] if self.module.count("/") > 1 else Path(self.module).parts[:1])

    @property
    def known_by(self) -> tuple[object, ...]:
        """What stays when code is moved."""
        return self.statement, self.kind, self.index, self.becomes


def changes(node: ast.AST) -> Iterator[Change]:
    """What may be changed in an expression."""
    if isinstance(node, ast.JoinedStr) or (isinstance(node, ast.Call) and SPARED.search(ast.unparse(node.func))):
        return
    match node:
        case ast.Compare(left, [op], right) if type(op) in TURNED:
            yield "comparison turned", node, ast.unparse(ast.Compare(left, [TURNED[type(op)]()], right))
        case ast.BoolOp(op, values):
            other = ast.Or() if isinstance(op, ast.And) else ast.And()
            yield "and/or swapped", node, ast.unparse(ast.BoolOp(other, values))
        case ast.BinOp(left, op, right) if type(op) in TURNED and not re.search(r"['\"\[]", ast.unparse(node)):
            yield "+/- swapped", node, ast.unparse(ast.BinOp(left, TURNED[type(op)](), right))
        case ast.Constant(bool(value)):
            yield "constant changed", node, repr(not value)
        case ast.Constant(int(value) | float(value)):
            yield "constant changed", node, repr(value * 2 if value % 1 else value + 1)
        case ast.UnaryOp(ast.Not(), operand):
            yield "not removed", node, ast.unparse(operand)
        case ast.IfExp(test):
            yield from (("condition forced", test, str(value)) for value in (True, False))
    for child in ast.iter_child_nodes(node):
        yield from changes(child)


def whole(statement: ast.stmt, returns: str) -> Iterator[Change]:
    """What may be done to a statement as a whole, in a function that returns this."""
    match statement:
        case ast.If(test) if not isinstance(test, ast.Constant):
            yield from (("condition forced", test, str(value)) for value in (True, False))
        case ast.Return(ast.expr() as value) if not isinstance(value, ast.Constant):
            instead = {"bool": "not ({})", "int": "({}) + 1", "float": "({}) + 1.0", "str": "''"}.get(returns, "None")
            yield "return replaced", value, instead.format(ast.unparse(value))
        case ast.Expr(ast.Call() | ast.Await()) | ast.AugAssign(ast.Attribute()):
            yield "statement deleted", statement, ""
        case ast.Assign(targets) if all(isinstance(target, ast.Attribute) for target in targets):
            yield "statement deleted", statement, ""


class Module:
    """All mutations of a module, and its functions."""

    def __init__(self, name: str, text: bytes) -> None:
        self.name, self.found = name, list[Mutation]()
        self.functions = list[tuple[Function, bool]]()  # and whether compiled
        self.starts = [0, *itertools.accumulate(len(line) for line in text.splitlines(keepends=True))]
        self._visit(ast.parse(text).body, "", None)

    def _visit(self, body: list[Any], owner: str, function: Function | None) -> None:
        """Statements of a body, within a class or function of that name, and of a function unless it is a class's."""
        for node in body:
            inner = f"{owner}.{getattr(node, 'name', '')}".strip(".")
            if isinstance(node, Function):
                by = "kernels" in self.name or any(COMPILED.match(ast.unparse(d)) for d in node.decorator_list)
                self.functions.append((node, by))
                self._visit(node.body, inner, node)
            elif isinstance(node, ast.ClassDef):
                self._visit(node.body, inner, None)
            elif not (isinstance(node, ast.If) and SPARED.search(ast.unparse(node.test))):
                if isinstance(node, ast.stmt):
                    self._statement(node, owner, function)
                within = [child for child in ast.iter_child_nodes(node) if not isinstance(child, ast.expr)]
                self._visit(within, owner, function)

    def _statement(self, node: ast.stmt, owner: str, function: Function | None) -> None:
        """Mutations of its own expressions, not of statements within it."""
        parts = [child for child in ast.iter_child_nodes(node) if isinstance(child, ast.expr | ast.withitem)]
        if isinstance(node, ast.AnnAssign):
            parts = [node.value] if node.value else []
        head = f"{type(node).__name__}: {'; '.join(ast.unparse(part) for part in parts)}"
        static = ""
        if function is None and isinstance(node, ast.Assign | ast.AnnAssign):
            target = node.targets[0] if isinstance(node, ast.Assign) else node.target
            static = owner.split(".")[-1] or getattr(target, "id", "")
        if isinstance(node, ast.Raise | ast.Assert) or SPARED.search(head) or not (function or static):
            return
        returns = ast.unparse(function.returns) if function and function.returns else ""
        count = collections.Counter[str]()
        for kind, what, becomes in (*whole(node, returns), *(one for part in parts for one in changes(part))):
            if static and kind != "constant changed":
                continue
            begin = self.starts[what.lineno - 1] + what.col_offset
            end = self.starts[(what.end_lineno or 0) - 1] + (what.end_col_offset or 0)
            text = ast.unparse(node) if kind == "statement deleted" else head
            place = (self.name, owner, text, kind, count[kind], becomes, what.lineno, (begin, end), static)
            self.found.append(Mutation(*place))
            count[kind] += 1


def modules(tree: Path) -> dict[str, Module]:
    """Every module of the product."""
    paths = itertools.chain(*((tree / top).rglob("*.py") for top in ("filters", "imutui")))
    names = sorted(str(path.relative_to(tree)) for path in paths)
    return {name: Module(name, (tree / name).read_bytes()) for name in names}


def drawn(tree: Path) -> list[Mutation]:
    """From rooms in turn, each as often as the root of its size: a kind, then a place; a statement only once."""
    rooms = collections.defaultdict[str, list[Mutation]](list)
    for one in (one for module in modules(tree).values() for one in module.found):
        rooms[one.room].append(one)
    chance, taken, had = random.Random(SEED), list[Mutation](), collections.Counter[str]()
    share = {room: len(found) ** 0.5 for room, found in rooms.items()}
    while len(taken) < NUMBER:
        room = min(share, key=lambda room: ((had[room] + 1) / share[room], room))
        had[room] += 1
        kind = chance.choice(sorted({one.kind for one in rooms[room]}))
        new = chance.choice([one for one in rooms[room] if one.kind == kind])
        taken.append(new)

        def apart(one: Mutation, new: Mutation = new) -> bool:
            elsewhere = one.module != new.module or one.span[1] <= new.span[0] or one.span[0] >= new.span[1]
            return elsewhere and (one.module, one.line) != (new.module, new.line) and one.statement != new.statement

        rooms[room] = [one for one in rooms[room] if apart(one)]
    return taken


def found_again(wanted: list[Mutation], tree: Path) -> list[Mutation | None]:
    """The same mutations of another tree; none where their code is not there as it was."""
    there = collections.defaultdict[tuple[object, ...], list[Mutation]](list)
    for one in (one for module in modules(tree).values() for one in module.found):
        there[one.known_by].append(one)

    def likeness(one: Mutation, other: Mutation) -> tuple[bool, ...]:
        names = one.function.split(".")[-1] == other.function.split(".")[-1]
        only = len(there[one.known_by]) == 1 and len(one.statement) > 40
        return names or only, one.module == other.module, one.function == other.function, one.line == other.line

    best = [max(there[one.known_by], key=lambda other: likeness(one, other), default=None) for one in wanted]
    return [other if other and likeness(one, other)[0] else None for one, other in zip(wanted, best, strict=True)]


def callers(name: str, found: dict[str, Module]) -> tuple[list[tuple[Module, Function]], bool]:
    """Functions that Python runs and that name this, or compiled ones that do; and whether there are such."""
    names, known, plain = set[str](), {name}, list[tuple[Module, Function]]()
    while names != known:
        names, plain = set(known), []
        for module in found.values():
            for node, compiled in module.functions:
                if names & {getattr(part, "id", getattr(part, "attr", "")) for part in ast.walk(node)}:
                    known |= {node.name} if compiled else set()
                    plain += [] if compiled else [(module, node)]
    return plain, len(names) > 1


def write(tree: Path, mutations: list[Mutation | None]) -> list[int]:
    """Write all into a tree, each behind its switch; returns those of compiled code, which gets probes alone."""
    found, apart = modules(tree), list[int]()
    edits = collections.defaultdict[str, list[tuple[int, int, str]]](list)
    for number, one in ((number, one) for number, one in enumerate(mutations) if one):
        switch = SWITCH.format(number)
        own = (tree / one.module).read_bytes()[slice(*one.span)].decode()
        in_kernel = (one.function.split(".")[-1], True) in [(node.name, by) for node, by in found[one.module].functions]
        if one.static or in_kernel:
            plain, compiled = callers(one.static or one.function.split(".")[-1], found)
            for module, node in plain:
                first = node.body[1 if ast.get_docstring(node) and len(node.body) > 1 else 0]
                line = min(part.lineno for part in (first, *getattr(first, "decorator_list", ())))
                begin = module.starts[line - 1]
                edits[module.name].append((begin, begin, f"{' ' * first.col_offset}{switch}\n"))
            if compiled or in_kernel:
                apart.append(number)
                continue
        deleted = f"if not {switch}: {ast.unparse(ast.parse(own))}"
        edits[one.module].append((*one.span, f"({one.becomes} if {switch} else ({own}))" if one.becomes else deleted))
    for name, changed in edits.items():
        text = (tree / name).read_bytes()
        for begin, end, instead in sorted(changed, reverse=True):
            text = text[:begin] + instead.encode() + text[end:]
        (tree / name).write_bytes(text)
    return apart


class Trees:
    """The copies of the tree, and the tests that run in them."""

    def __init__(self, work: Path, commit: str, processes: int) -> None:
        self.work, self.processes = work.resolve(), processes
        # of each test; a test of which no time is known takes none
        self.seconds: dict[str, float] = collections.defaultdict(float)
        self.wanted = drawn(self._copy("drawn", DRAWN_AT))
        self.mutations = found_again(self.wanted, self._copy("plain", commit))
        self.tree, marker = self._copy("switched", commit), self.work / "compiled.json"
        if not marker.exists():
            (self.work / "probe").mkdir(exist_ok=True)
            (self.work / "probe" / "mutation_probe.py").write_text(PROBE)
            marker.write_text(json.dumps(write(self.tree, self.mutations)))
        self.apart = json.loads(marker.read_text())
        self.tests = self._reaching()

    def _copy(self, name: str, commit: str) -> Path:
        place, shared = self.work / name, self.work / "shared"
        if not place.exists():
            place.mkdir(parents=True)
            packed = subprocess.run(["git", "archive", commit], cwd=ROOT, check=True, capture_output=True).stdout
            subprocess.run(["tar", "x", "-C", place], input=packed, check=True)
            if not shared.exists():  # measured recordings, if there are any
                shared.symlink_to((ROOT.parent / "shared").resolve())
        return place

    def _pytest(self, tree: Path, name: str, arguments: list[str], limit_s: float, **switches: object) -> int | None:
        """Exit code; none when it took too long. Its output and log are files; whatever it left running is ended."""
        mark, log = f"PYTEST_MUTATION_RUN={os.getpid()}-{name}-{random.random()}", self.work / f"{name}.log"
        log.unlink(missing_ok=True)
        cache = self.work / ("numba" if tree == self.tree else f"{tree.name}-numba")
        own = {
            "PYTEST_MUTATION_RUN": mark.partition("=")[2],
            "PYTEST_MUTATION_LOG": str(log),
            "NUMBA_CACHE_DIR": str(cache),
        }
        own["PYTHONPATH"] = os.pathsep.join((str(tree), str(self.work / "probe")))
        own |= {f"PYTEST_MUTATION_{switch.upper()}": str(value) for switch, value in switches.items()}
        command = [sys.executable, "-m", "pytest", "-p", "mutation_probe", "-q", "--hypothesis-seed=0", *arguments]
        with (self.work / f"{name}.out").open("w") as out:
            environment = os.environ | own
            process = subprocess.Popen(
                command, cwd=tree, env=environment, start_new_session=True, stdout=out, stderr=subprocess.STDOUT
            )
        try:
            return process.wait(limit_s)
        except subprocess.TimeoutExpired:
            return None
        finally:
            for one in Path("/proc").glob("[0-9]*/environ"):
                with contextlib.suppress(OSError):
                    if mark.encode() in one.read_bytes():
                        os.kill(int(one.parent.name), signal.SIGKILL)
            process.wait()

    def _log(self, name: str) -> list[str]:
        """Lines of a run: outcome, seconds and test, of each part of each; and a mutation's number, test and part."""
        path = self.work / f"{name}.log"
        return path.read_text().splitlines() if path.exists() else []

    def _reaching(self) -> dict[int, list[str]]:
        """Tests that reach a mutation, in the order to run them in; none that fails without it."""
        if not (self.work / "reached").exists():
            self._pytest(self.tree, "suite", ["-n", str(self.processes)], 4 * 3600.0)
            (self.work / "reached").touch()
        reports = [line.split(" ", 3) for line in self._log("suite") if not line[0].isdigit()]
        setup_s, rank = collections.defaultdict[str, float](float), collections.Counter[str]()
        for _, part, seconds, test in reports:
            if part == "setup":  # what is made for one test of a module may be made for whichever comes first
                setup_s[test.split("::")[0]] = max(setup_s[test.split("::")[0]], float(seconds))
            else:
                self.seconds[test] += float(seconds)
        for test in self.seconds:
            self.seconds[test] += setup_s[test.split("::")[0]]
        files = collections.defaultdict[str, dict[str, int]](dict)
        for test in sorted(self.seconds, key=self.seconds.__getitem__):
            files[test.split("::")[0]][test] = rank[test.split("[")[0]]
            rank[test.split("[")[0]] += 1
        tests = collections.defaultdict[int, set[str]](set)
        for line in (line for line in self._log("suite") if line[0].isdigit()):
            number, test, part = re.fullmatch(r"(\d+) (.*) \((\w+)\)", line).groups()  # type: ignore[union-attr]
            tests[int(number)] |= files[test.split("::")[0]].keys() if part == "setup" else {test}
        failing = {test for outcome, _, _, test in reports if outcome != "passed"}
        return {number: self._chosen(found - failing, files.values()) for number, found in tests.items()}

    def _chosen(self, tests: set[str], files: Iterable[dict[str, int]]) -> list[str]:
        """The fastest of each file, then the next of each; of one with parameters, the second set after all others."""
        taken, left_s = list[str](), MOST_S
        turns = itertools.zip_longest(
            *([test for test in sorted(of, key=of.__getitem__) if test in tests] for of in files)
        )
        for test in filter(None, itertools.chain(*turns)):
            if not taken or (len(taken) < MOST_TESTS and self.seconds[test] < left_s):
                taken.append(test)
                left_s -= self.seconds[test]
        return sorted(taken, key=self.seconds.__getitem__)

    def fate(self, number: int) -> tuple[str, str]:
        """What becomes of a mutation, and by which test."""
        one, tree, tests, name = self.mutations[number], self.tree, self.tests.get(number, []), f"mutation-{number}"
        if one is None or not tests:
            return "unreached" if one else "gone", ""
        switches: dict[str, object] = {"on": number, "warm": 1}
        if number in self.apart:
            tree = shutil.copytree(self.work / "plain", self.work / name, dirs_exist_ok=True)
            text = (tree / one.module).read_bytes()
            instead = f"({one.becomes})" if one.becomes else "pass"
            (tree / one.module).write_bytes(text[: one.span[0]] + instead.encode() + text[one.span[1] :])
            switches = {}
        options, listed = ["-x", "-n", "0", f"--timeout={TEST_S}"], self.work / f"{name}.tests"
        while tests:
            listed.write_text("\n".join(tests))
            limit_s = 120.0 + 5.0 * sum(self.seconds[test] for test in tests) + (0.0 if switches else 1200.0)
            code = self._pytest(tree, name, [*options, f"@{listed}"], limit_s, **switches)
            if code in (0, None):
                return "survived" if code == 0 else "timed out", ""
            failed = next((line.split(" ", 3)[3] for line in self._log(name) if line.startswith("failed ")), "")
            sure = failed and self.seconds[failed] < 1.0  # it waits for nothing
            alone = [*options, failed or f"@{listed}"]
            if sure or self._pytest(self.tree, f"{name}-off", alone, limit_s, warm=1) == 0:
                return "caught", failed or "no test runs"
            if not failed:
                break
            tests = [test for test in tests if test != failed]
        return "not told", "its tests fail without it"


def run(trees: Trees, out: Path) -> dict[str, Any]:
    """Run what has not been run yet; results are written after each."""
    results: dict[str, Any] = json.loads(out.read_text()) if out.exists() else {}
    todo = sorted(set(range(NUMBER)) - {int(number) for number in results}, key=lambda n: (n in trees.apart, n))
    with concurrent.futures.ThreadPoolExecutor(trees.processes) as pool:
        runs = {pool.submit(trees.fate, number): number for number in todo}
        for done in concurrent.futures.as_completed(runs):
            (fate, by), number = done.result(), runs[done]
            here = trees.mutations[number] or trees.wanted[number]
            about = {"room": here.room, "fate": fate, "by": by, "tests": len(trees.tests.get(number, ()))}
            results[str(number)] = asdict(here) | about
            out.write_text(json.dumps(results, indent=1))
            print(f"{len(results)} of {NUMBER}: {number} {fate} {by}", flush=True)
    return results


def table(results: dict[str, Any]) -> None:
    """Fates by room, and what is not caught."""
    rooms = collections.defaultdict[str, collections.Counter[str]](collections.Counter)
    for one in results.values():
        rooms[one["room"]][one["fate"]] += 1
        rooms["~ all"][one["fate"]] += 1
    print(f"| room | {' | '.join(FATES)} |\n{'|---' * (len(FATES) + 1)}|")
    for room, count in sorted(rooms.items()):
        print(f"| {room} | {' | '.join(str(count[fate]) for fate in FATES)} |")
    for number, one in results.items():
        if one["fate"] not in ("caught", "timed out", "gone"):
            print(f"\n{number}. {one['module']}:{one['line']} {one['function']}: {one['kind']}, {one['fate']}")
            print(f"    {one['statement'][:160]}\n    -> {one['becomes'][:110]}")


def compare(before: dict[str, Any], after: dict[str, Any]) -> bool:
    """Print what differs, and what is caught at neither; returns whether as many are caught of those that are left."""
    caught = [{n for n, one in results.items() if one["fate"] in FATES[:2]} for results in (before, after)]
    left = {number for number, one in after.items() if one["fate"] != "gone"}
    print(f"caught before {len(caught[0])}, of which {len(caught[0] & left)} are left; after {len(caught[1])}")
    print("no longer caught:", *sorted(caught[0] & left - caught[1], key=int))
    print("caught now:", *sorted(caught[1] - caught[0], key=int), "\n\nCaught at neither:\n")
    table({number: after[number] for number in after if number in left - caught[0] - caught[1]})
    return len(caught[1]) >= len(caught[0] & left)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("do", choices=("run", "table"))
    parser.add_argument("results", type=Path, nargs="+")
    parser.add_argument("--commit", default=DRAWN_AT)
    parser.add_argument("--work", type=Path, default=Path("/tmp/imutui-mutations"))
    parser.add_argument("--processes", type=int, default=2)
    asked = parser.parse_args()
    if asked.do == "run":
        run(Trees(asked.work, asked.commit, asked.processes), asked.results[0])
    read = [json.loads(path.read_text()) for path in asked.results]
    table(read[-1])
    if len(read) > 1:
        sys.exit(not compare(*read))
