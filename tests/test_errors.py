"""Who may take which exception for the user's: read from the syntax trees.

What an input can cause is an `InputError`, raised where the input is read. An exception that a fault of ours raises as
well, such as a ValueError, says so only of a `try` that calls nothing of ours: a conversion by another's function.
"""

import ast
import builtins
import io
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np
from helpers.modules import MODULES, PACKAGES, tree_of, within

FAULTS = {
    "ValueError", "TypeError", "KeyError", "IndexError", "LookupError", "AttributeError", "ArithmeticError",
    "OverflowError", "RecursionError", "Exception", "BaseException",
}  # fmt: skip
"""Exceptions that a fault of ours may raise."""

EXEMPT = {
    "imutui.cli.main": "the last resort of a command, which tells a defect from the rest",
    "imutui.cli.exit_codes.handled": "the same",
    "imutui.cli.replay._one": "the same, in a process beside",
    "imutui.cli.spoil": "runs what the user wrote",
    "imutui.jobs.worker": "the border of a process: the other side is told which it was",
    "imutui.jobs.campaign.one_log.row_of": "one log must never end a campaign; its row says that it is a defect",
    "imutui.session.batch.asked_of": "reads what a version of this program wrote; the user learns that it was another",
    "imutui.session.__main__.main": "the border of a process: whoever started it is told",
    "imutui.session.engine": "the thread that records: a defect ends it in order, or is its asker's",
    "imutui.session.ipc.reply_to": "a viewer that waits must hear something, and the others go on",
    "imutui.table.keeper.main": "a defect of the keeper must not leave the table turning",
    "imutui.session.live_filter": "the recorder raises it once the file has the packets",
    "imutui.session.reader_thread.Reader._run": "the worker raises it, and so ends the acquisition as failed",
}
"""Functions, or whole modules, that may take any exception of ours, and why."""


_FOREIGN = (Path, np.ndarray, io.BufferedReader, io.TextIOWrapper)


@cache
def own_methods() -> frozenset[str]:
    """Names of methods of ours that none of the usual classes of others has."""
    ours = {
        function.name
        for module in MODULES
        for kind in ast.walk(tree_of(module))
        if isinstance(kind, ast.ClassDef)
        for function in kind.body
        if isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef)
    }
    kinds = [kind for kind in (*vars(builtins).values(), *_FOREIGN) if isinstance(kind, type)]
    foreign = {name for kind in kinds for name in dir(kind)}
    return frozenset(ours - foreign)


@cache
def own_names(module: str) -> frozenset[str]:
    """What a module calls by a bare name, or by what stands before a dot, and that is ours."""
    names = set()
    for node in ast.walk(tree_of(module)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            names.add(node.name)
        elif isinstance(node, ast.ImportFrom) and any(within(node.module or "", package) for package in PACKAGES):
            names |= {alias.asname or alias.name for alias in node.names}
        elif isinstance(node, ast.Import):
            names |= {a.asname or a.name for a in node.names if any(within(a.name, package) for package in PACKAGES)}
    return frozenset(names | {"self", "cls"})


@cache
def foreign_modules(module: str) -> frozenset[str]:
    imported = [node for node in ast.walk(tree_of(module)) if isinstance(node, ast.Import)]
    return frozenset(a.asname or a.name.split(".")[0] for node in imported for a in node.names)


def is_ours(module: str, called: ast.expr) -> bool:
    """Whether what is called is a function, a class or a method of ours."""
    if isinstance(called, ast.Name):
        return called.id in own_names(module)
    if not isinstance(called, ast.Attribute):
        return False
    if isinstance(called.value, ast.Name):
        of = called.value.id
        return of in own_names(module) or (called.attr in own_methods() and of not in foreign_modules(module))
    return called.attr in own_methods()


def calls_ours(module: str, body: list[ast.stmt]) -> str | None:
    """The first call of ours among statements, but for the functions that these only define."""
    waiting: list[ast.AST] = [*body]
    while waiting:
        node = waiting.pop(0)
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            continue
        if isinstance(node, ast.Call) and is_ours(module, node.func):
            return ast.unparse(node.func)
        waiting += ast.iter_child_nodes(node)
    return None


def constants(module: str) -> dict[str, ast.expr]:
    """What names at the top of a module stand for, such as a tuple of exceptions."""
    return {
        target.id: node.value
        for node in tree_of(module).body
        if isinstance(node, ast.Assign)
        for target in node.targets
        if isinstance(target, ast.Name)
    }


def faults_in(module: str, caught: ast.expr | None) -> set[str]:
    """Which of `FAULTS` an `except` names, itself or by a constant of this or another module of ours."""
    if caught is None:
        return {"everything"}
    known = {name: value for each in MODULES for name, value in constants(each).items() if isinstance(value, ast.Tuple)}
    waiting, found = [caught], set()
    while waiting:
        for node in ast.walk(waiting.pop()):
            name = node.id if isinstance(node, ast.Name) else node.attr if isinstance(node, ast.Attribute) else ""
            found |= {name} & FAULTS
            waiting += [known[name]] if name in known else []
    return found


def guarded(module: str) -> Iterator[tuple[str, list[ast.stmt], set[str]]]:
    """Where exceptions are taken: the function, what may raise them, and which of `FAULTS`; not what passes them on."""

    def visit(node: ast.AST, where: str) -> Iterator[tuple[str, list[ast.stmt], set[str]]]:
        for child in ast.iter_child_nodes(node):
            inside = where
            if isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
                inside = f"{where}.{child.name}"
            if isinstance(child, ast.Try):
                for handler in child.handlers:
                    if not (isinstance(handler.body[-1], ast.Raise) and handler.body[-1].exc is None):
                        yield inside, child.body, faults_in(module, handler.type)
            elif isinstance(child, ast.With):
                for item in child.items:
                    call = item.context_expr
                    if isinstance(call, ast.Call) and ast.unparse(call.func).endswith("suppress"):
                        yield inside, child.body, set().union(*(faults_in(module, each) for each in call.args))
            yield from visit(child, inside)

    yield from visit(tree_of(module), module)


def test_nothing_of_ours_is_called_where_a_fault_would_be_taken_for_the_input() -> None:
    """Or numpy's ValueError out of a fault of ours is told as wrong usage, and nobody reports it."""
    wrong, met = [], set()
    for module in MODULES:
        for where, body, faults in guarded(module):
            if faults and (called := calls_ours(module, body)) is not None:
                reasons = {name for name in EXEMPT if within(where, name)}
                met |= reasons
                wrong += [] if reasons else [f"{where}: {called} under except {', '.join(sorted(faults))}"]
    assert not wrong, "\n".join(wrong)
    assert met == set(EXEMPT), "an exemption that nothing needs"
