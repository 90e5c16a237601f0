"""Textual's private names: in one module, and dispensable."""

import ast
import importlib
import importlib.util
import inspect
import pkgutil
import re
from functools import cache
from pathlib import Path

import pytest
import textual._compositor as compositor
from helpers.fake_client import FakeClient
from helpers.pilot import SMALLEST, shows
from rich.console import Console
from textual.app import App
from textual.css.stylesheet import Stylesheet
from textual.driver import Driver
from textual.drivers.linux_driver import LinuxDriver
from textual.message_pump import MessagePump
from textual.screen import Screen
from textual.widget import Widget

import imutui.tui
from imutui.tui.app import ImutuiApp
from imutui.tui.pages.base import PAGES
from imutui.tui.terminal import textual_private

MODULES = [
    info.name
    for info in pkgutil.walk_packages(imutui.tui.__path__, "imutui.tui.")
    if not info.name.endswith("textual_private")
]
SIGNS = ("Connected", "gx", "flushed", "x gyro", "profile", "6 Logs")  # a text of each page
ALL = {*textual_private.DRAWING, *textual_private.MEASURING, *textual_private.PARSING, "_color_system"}


def private_names(cls: type) -> set[str]:
    """Underscored names that a class's bases outside this package have, in the class or set on `self`."""
    bases = [base for base in cls.__mro__ if base.__module__.split(".")[0] in ("textual", "rich")]
    return set().union(*(names_of(base) for base in bases))


@cache
def names_of(base: type) -> set[str]:
    found = {*vars(base), *re.findall(r"\bself\.(_\w+)", inspect.getsource(base))}
    return {name for name in found if name.startswith("_") and not name.endswith("__")}


def own_names(cls: type) -> set[str]:
    """Underscored names that a class itself defines, or uses on `self`."""
    return set(re.findall(r"(?:\bself\.|\bsuper\(\)\.|def )(_[a-z]\w*)", inspect.getsource(cls)))


def test_no_other_module_touches_a_private_name_of_textual() -> None:
    """Neither on purpose nor by having the same name for something else."""
    everybodys = set().union(*(private_names(cls) for cls in (App, Screen, Widget, LinuxDriver, Console)))
    for module in MODULES:
        loaded = importlib.import_module(module)
        for node in ast.walk(ast.parse(Path(loaded.__file__ or "").read_text())):
            if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] in ("textual", "rich"):
                names = [*(node.module or "").split("."), *(alias.name for alias in node.names)]
                assert not any(name.startswith("_") for name in names), f"{module}: {ast.unparse(node)}"
            if isinstance(node, ast.Attribute) and ast.unparse(node.value) not in ("self", "copy", "super()", "os"):
                assert node.attr not in everybodys, f"{module}: {ast.unparse(node)}"
        for cls in vars(loaded).values():
            if isinstance(cls, type) and cls.__module__ == module and issubclass(cls, (MessagePump, Driver)):
                clash = own_names(cls) & private_names(cls)
                assert not clash, f"{module}: {cls.__name__} has {sorted(clash)}"


async def test_pages_draw_without_the_private_names(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(textual_private, "HIDDEN", set(ALL))
    client = FakeClient()
    client.recording = True
    app = ImutuiApp(client)  # type: ignore[arg-type]
    assert not textual_private.draw_through(app, lambda update: update)
    assert not isinstance(app.stylesheet, textual_private.KeptStylesheet)
    async with app.run_test(size=SMALLEST) as pilot:
        await shows(pilot, "SIMULATED", "gx, deg/s", "lost 0")
        client.changes["lost_packets"] = client.changes["lost_packets_max"] = 7
        await shows(pilot, "lost 7")
        for (key, title), sign in zip(PAGES, SIGNS, strict=True):
            await pilot.press(key)
            await shows(pilot, f"{key} {title}", sign, "q quit")


def test_a_textual_without_them_is_noticed_and_not_tripped_over(monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as without:
        for name in ("ChopsUpdate", "LayoutUpdate", "CompositorUpdate"):
            without.delattr(compositor, name)
        spec = importlib.util.spec_from_file_location("without_updates", textual_private.__file__)
        assert spec is not None
        assert spec.loader is not None
        made = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(made)
    assert {"ChopsUpdate", "LayoutUpdate"} <= set(made.missing())
    assert not made.draw_through(ImutuiApp(), lambda update: update)


def test_a_style_sheet_that_is_kept_has_the_rules_of_one_parsed_anew() -> None:
    app = ImutuiApp()
    kept = app.stylesheet
    assert isinstance(kept, textual_private.KeptStylesheet)
    kept.read_all(app.css_path)
    kept.add_source("Label { color: $primary; }", ("here", ""))
    dark = app.get_css_variables()
    light = {**dark, **app.get_theme("textual-light").to_color_system().generate()}  # type: ignore[union-attr]
    found = []
    for variables in (dark, light, dark):
        anew = Stylesheet(variables=variables)
        anew.source = dict(kept.source)
        anew.parse()
        kept.set_variables(variables)
        kept.reparse()
        assert kept.css == anew.css
        found.append(kept.rules)
    assert found[0] != found[1]
    assert [id(rule) for rule in found[0]] == [id(rule) for rule in found[2]]


def test_this_textual_has_them_all() -> None:
    assert textual_private.missing() == []
    assert textual_private.keep_parsed_styles(ImutuiApp())
