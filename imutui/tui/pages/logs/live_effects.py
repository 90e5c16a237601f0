"""Loading found effects into the live filter: which, from where, and whether it takes them now."""

from pathlib import Path
from typing import TYPE_CHECKING

from imutui.session.client import Client
from imutui.tui.background import in_thread
from imutui.tui.pages.base import Page
from imutui.tui.pages.dialogs.path import PathDialog
from imutui.tui.pages.logs import text
from imutui.tui.pages.logs.effects_dialog import EffectsDialog

if TYPE_CHECKING:
    from imutui.jobs.sidecar_files import EffectsFile


class LiveEffects:
    """Asks for effects in front of a page, and has the acquisition take them.

    `page`: what is said is said there; its newest view says whether a recording runs.
    """

    def __init__(self, page: Page) -> None:
        self._page = page
        self._folder = Path()

    def choose(self, folder: Path) -> None:
        """Ask which effects the live filter shall take, of those in a folder and in the working folder."""
        self._folder = folder
        self._page.run_worker(self._choose(), exclusive=True, group="effects")

    async def _choose(self) -> None:
        folders = list(dict.fromkeys([self._folder, Path()]))
        files = await in_thread(lambda: _effects_files(folders))
        now = self._page.view.now if self._page.view is not None else None
        loaded = now is not None and bool(now["effects"])
        self._page.app.push_screen(EffectsDialog(files, loaded), self._chosen)

    def _chosen(self, file: "EffectsFile | str | None") -> None:
        if file == "none":
            self.load("no effects", "")
        elif file == "open":
            hint = "A TOML file that a trace wrote. Enter opens it, Esc cancels."
            self._page.app.push_screen(PathDialog("Effects file", hint, f"{self._folder}/"), self._typed)
        elif file is not None and not isinstance(file, str):
            self.load(file.path.name, file.text)

    def _typed(self, entered: str | None) -> None:
        if entered is not None:
            self._page.run_worker(self._open(entered), exclusive=True, group="effects")

    async def _open(self, entered: str) -> None:
        file = await in_thread(lambda: _effects_file(Path(entered).expanduser()))
        if file.error:
            self._page.post_message(Page.Say(f"{entered}: {file.error}", "bad"))
        else:
            self.load(file.path.name, file.text)

    def load(self, name: str, content: str) -> None:
        """Have the live filter take effects; it begins anew."""
        refused = text.refused(self._page.view.recording if self._page.view is not None else None, "effects")
        if refused is not None:
            self._page.post_message(Page.Say(refused, "wait"))
            return

        def ask(client: Client) -> str:
            client.configure(effects=content)
            return f"loaded {name}: the filter began anew with it"

        self._page.post_message(Page.Ask(ask, f"loading {name}"))


def _effects_files(folders: list[Path]) -> "list[EffectsFile]":
    from imutui.jobs import sidecar_files

    return sidecar_files.effects_files(folders)


def _effects_file(path: Path) -> "EffectsFile":
    from imutui.jobs import sidecar_files

    return sidecar_files.effects_file(path)
