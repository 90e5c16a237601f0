"""The command palette: every action of the page in front and of the application, with its key."""

from collections.abc import Callable, Iterable
from typing import Any

from textual.app import App, SystemCommand
from textual.binding import Binding

from imutui.tui.pages.base import PAGES, Page
from imutui.tui.pages.registry import SCREENS


def commands(app: App[Any], page: Page | None, go: Callable[[str], None]) -> Iterable[SystemCommand]:
    """Pages, then the page's actions, then the application's.

    `app`: runs its own actions.
    `page`: the page in front, which runs its own.
    `go`: goes to a page by name.
    """
    for (key, title), name in zip(PAGES, SCREENS, strict=True):
        yield SystemCommand(f"{title} page", f"key {key}", lambda name=name: go(name))
    for namespace in (page, app):
        for binding in namespace.BINDINGS if namespace is not None else ():
            if isinstance(binding, Binding) and (binding.show or binding.tooltip):
                yield _command(app, namespace, binding)


def _command(app: App[Any], namespace: Page | App[Any] | None, binding: Binding) -> SystemCommand:
    tip = binding.tooltip
    title = binding.description.capitalize() + (f": {tip[0].lower()}{tip[1:]}" if tip else "")

    async def run() -> None:
        app.screen.set_focus(None)  # in a field, letters are text and no action answers to them
        await app.run_action(binding.action, namespace)

    return SystemCommand(title, f"key {binding.key_display or _shown(binding.key)}", run)


def _shown(key: str) -> str:
    """First of a binding's keys as people write it."""
    *modifiers, last = key.partition(",")[0].split("+")
    return "-".join([*(modifier.capitalize() for modifier in modifiers), last])
