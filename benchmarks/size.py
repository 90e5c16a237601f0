"""Lines and modules of each room, and how many modules only one other imports, of one tree or of several side by side.

python benchmarks/size.py . ../before
"""

import ast
import sys
from collections import Counter, defaultdict
from pathlib import Path

PRODUCT = ("filters", "imutui")


def room(path: Path) -> str:
    """The folder of `filters`, `imutui` or `tests` that a module is in; a top folder's own modules are a room."""
    return "/".join(path.parts[: 2 if len(path.parts) > 2 else 1])


def imported(path: Path, names: set[str]) -> set[str]:
    """Modules of the product that a module names in its imports, also those within functions."""
    found = set[str]()
    for node in ast.walk(ast.parse(path.read_bytes())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return found & names


def sizes(tree: Path) -> dict[str, Counter[str]]:
    """Lines, modules and modules with one importer, a room."""
    paths = [path for top in (*PRODUCT, "tests", "benchmarks") for path in (tree / top).rglob("*.py")]
    names = {".".join(path.relative_to(tree).with_suffix("").parts): path for path in paths}
    importers = defaultdict[str, set[Path]](set)
    for path in (path for path in paths if path.relative_to(tree).parts[0] in PRODUCT):
        for name in imported(path, set(names)):
            importers[name].add(path)
    found = defaultdict[str, Counter[str]](Counter)
    for name, path in names.items():
        relative = path.relative_to(tree)
        for of in (room(relative), f"{relative.parts[0]}, all"):
            found[of].update(lines=path.read_bytes().count(b"\n"), modules=1, one=len(importers[name]) == 1)
    return found


if __name__ == "__main__":
    trees = [sizes(Path(tree)) for tree in sys.argv[1:] or ["."]]
    print(f"{'lines, modules, with one importer':28}", *sys.argv[1:], sep="  ")
    for of in sorted({of for tree in trees for of in tree}):
        print(f"{of:28}", *(f"{tree[of]['lines']:8} {tree[of]['modules']:4} {tree[of]['one']:4}" for tree in trees))
