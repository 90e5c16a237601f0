"""Whether udev would understand a rules file: its grammar, its keys and where its jumps lead.

It stands in for `udevadm verify`, which came with systemd 254. What it leaves out: whether attributes exist.
"""

import re
from collections.abc import Iterator

_MATCH, _ASSIGN = frozenset({"==", "!="}), frozenset({"=", "+=", "-=", ":="})
_EITHER = _MATCH | _ASSIGN
_ONCE = frozenset({"="})

# key → operators, and whether it takes an attribute in braces
_KEYS: dict[str, tuple[frozenset[str], bool]] = {
    **dict.fromkeys(("ACTION", "DEVPATH", "KERNEL", "KERNELS", "SUBSYSTEM", "SUBSYSTEMS"), (_MATCH, False)),
    **dict.fromkeys(("DRIVER", "DRIVERS", "TAGS", "RESULT"), (_MATCH, False)),
    "ATTRS": (_MATCH, True),
    "ATTR": (_EITHER, True),
    "ENV": (_EITHER, True),
    "CONST": (_MATCH, True),
    "SYSCTL": (_EITHER, True),
    "TEST": (_MATCH, False),
    "PROGRAM": (_EITHER, False),
    "IMPORT": (_EITHER, True),
    **dict.fromkeys(("NAME", "SYMLINK", "TAG"), (_EITHER, False)),
    **dict.fromkeys(("OWNER", "GROUP", "MODE", "OPTIONS"), (_ASSIGN, False)),
    **dict.fromkeys(("SECLABEL",), (_ASSIGN, True)),
    "RUN": (_ASSIGN, False),
    **dict.fromkeys(("GOTO", "LABEL"), (_ONCE, False)),
}
_OPTIONAL = frozenset({"RUN", "TEST"})
"""Keys that may have an attribute in braces, and may not."""

_TOKEN = re.compile(
    r'(?P<key>[A-Z_]+)(?:\{(?P<attribute>[^}"]+)\})?\s*(?P<operator>==|!=|\+=|-=|:=|=)\s*"(?P<value>[^"]*)"'
)
_BETWEEN = re.compile(r"\s*,\s*")


def problems(text: str) -> list[tuple[int, str]]:
    """Line number of each trouble, and what it is; empty if there is none."""
    found: list[tuple[int, str]] = []
    labels: dict[str, int] = {}
    jumps: dict[str, int] = {}
    for number, line in _lines(text):
        tokens, trouble = _tokens(line)
        found += [(number, what) for what in trouble]
        for key, value in tokens:
            if key == "LABEL":
                labels[value] = number
            elif key == "GOTO":
                jumps.setdefault(value, number)
    found += [(at, f'GOTO="{name}" leads nowhere') for name, at in jumps.items() if labels.get(name, 0) <= at]
    found += [(at, f'LABEL="{name}" is unused') for name, at in labels.items() if name not in jumps]
    return sorted(found)


def _lines(text: str) -> Iterator[tuple[int, str]]:
    """Rules with their first line's number; a line that ends with a backslash goes on in the next."""
    held, begun = "", 0
    for number, line in enumerate(text.splitlines(), 1):
        stripped = line.strip()
        if not held and (not stripped or stripped.startswith("#")):
            continue
        begun = begun or number
        if stripped.endswith("\\"):
            held += stripped[:-1]
            continue
        yield begun, held + stripped
        held, begun = "", 0
    if held:
        yield begun, held


def _tokens(line: str) -> tuple[list[tuple[str, str]], list[str]]:
    """Keys and values of a rule, and what is wrong with it."""
    tokens: list[tuple[str, str]] = []
    wrong: list[str] = []
    at = 0
    while at < len(line):
        match = _TOKEN.match(line, at)
        if match is None:
            return tokens, [*wrong, f'not KEY=="value" or KEY="value": {line[at:]}']
        wrong += _judge(match)
        tokens.append((match["key"], match["value"]))
        at = match.end()
        comma = _BETWEEN.match(line, at)
        if at < len(line) and comma is None:
            return tokens, [*wrong, f"a comma is expected before: {line[at:].strip()}"]
        at = comma.end() if comma else at
    return tokens, wrong


def _judge(token: "re.Match[str]") -> list[str]:
    key, attribute, operator = token["key"], token["attribute"], token["operator"]
    if key not in _KEYS:
        return [f"there is no key {key}"]
    operators, takes_attribute = _KEYS[key]
    wrong = [] if operator in operators else [f"{key} takes no {operator}"]
    if key not in _OPTIONAL and takes_attribute != (attribute is not None):
        wrong.append(f"{key} {'lacks its' if takes_attribute else 'has no'} attribute in braces")
    if key == "MODE" and not re.fullmatch(r"[0-7]{3,4}", token["value"]):
        wrong.append(f"{token['value']} is no mode")
    return wrong
