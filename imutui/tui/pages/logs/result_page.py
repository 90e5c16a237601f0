"""A job's result: text to scroll, and what can be made of it."""

import errno
import json
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import ClassVar

from textual import events, work
from textual.binding import Binding, BindingType
from textual.containers import VerticalScroll
from textual.content import Content
from textual.widget import Widget
from textual.widgets import Static

from imutui.jobs import log_files
from imutui.report import effect_words
from imutui.tui import formatting
from imutui.tui.background import in_thread
from imutui.tui.pages import requests
from imutui.tui.pages.base import Page
from imutui.tui.pages.dialogs.choice import Answer, ChoiceDialog
from imutui.tui.pages.logs import comparison, result_text
from imutui.tui.pages.logs.result_text import Outcome
from imutui.tui.terminal.glyphs import choose
from imutui.tui.widgets import text_plot
from imutui.tui.widgets.raster import Line
from imutui.tui.widgets.text_plot import PlotLook

_WIDEST = 110
_WIDEST_PLOTS = 150
_MOST = 9
ELSEWHERE = "This result has nothing for that key. Esc goes back to the recordings: there x chooses, t traces."
AGAIN = "l shows the last result again"


class ResultPage(Page):
    """Above the logs page until Esc.

    `others`: results that were shown before, for a comparison.
    """

    TITLE = "Logs"
    AUTO_FOCUS = "#result-room"
    CSS = """
    ResultPage #result-room { height: 1fr; padding: 0 1; scrollbar-size-vertical: 1; }
    ResultPage #result-title { height: 1; padding: 0 1; background: $panel; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("w", "write_effects", "write", tooltip="Write the found effects beside the log"),
        Binding("e", "load_effects", "load", tooltip="Load the found effects into the live filter"),
        Binding(
            "x", "write_experiment", "experiment", tooltip="Write the motion that would separate the causes; 5 runs it"
        ),
        Binding("s", "save", "JSON", tooltip="Write the result document beside the log"),
        Binding("p", "plots", "plots", show=False, tooltip="To the plots, and back to the text"),
        Binding("c", "compare", "compare", show=False, tooltip="Another result of the same kind beside this one"),
        Binding("escape", "leave", "back", show=False),
        Binding("down,j", "scroll('down')", show=False),
        Binding("up,k", "scroll('up')", show=False),
        Binding("pagedown,space", "scroll('page_down')", show=False),
        Binding("pageup", "scroll('page_up')", show=False),
        Binding("home", "scroll('home')", show=False),
        Binding("end", "scroll('end')", show=False),
        # what else a key of the list does, and what this result has not
        Binding("x,t,i,v,n,o,l,R,D,w,e,s,p,c,left,right,enter,delete", "elsewhere", show=False),
    ]

    def __init__(self, outcome: Outcome, others: Sequence[Outcome] = ()) -> None:
        super().__init__()
        self.outcome = outcome
        self._others = [other for other in others if other.kind == outcome.kind and other is not outcome]
        self._begin_of_plots = 0
        self._left = False  # whether another page was in front meanwhile

    def body(self) -> Iterable[Widget]:
        offered = (("plots", "p plots  "), ("compare", "c compare  "))
        keys = "".join(key for action, key in offered if self.check_action(action, ())) + "y copies  Esc back"
        room = self.app.size.width - len(keys) - 5
        yield Static(
            choose().text(f"{formatting.shorten(self.outcome.title, room)}   {keys}"), id="result-title", markup=False
        )
        with VerticalScroll(id="result-room"):
            yield Static(id="result")

    def on_mount(self) -> None:
        super().on_mount()
        self._write()

    def on_screen_suspend(self) -> None:
        super().on_screen_suspend()
        self._left = self._left or self.app.current_mode != "logs"

    def on_screen_resume(self) -> None:
        """Give way to the list when the operator comes from another page: a result is shown where it is asked for."""
        super().on_screen_resume()
        if self._left:
            self.say(AGAIN)
            self.call_later(self.action_leave)  # behind what is said

    def action_elsewhere(self) -> None:
        self.say(ELSEWHERE, "wait")

    def on_resize(self, event: events.Resize) -> None:
        super().on_resize(event)
        self._write()

    def _write(self) -> None:
        said = self._text()
        parts = result_text.styled(choose().text(said))
        plots = self._plots()
        self._begin_of_plots = said.count("\n") + 2
        if plots:
            parts += ["\n\n", *text_plot.text(plots)]
        self.query_one("#result", Static).update(Content.assemble(*parts))
        self.refresh_bindings()

    def _plots(self) -> list[Line]:
        glyphs, app = choose(), self.app
        shades = not (app.no_color or app.native_ansi_color or glyphs.name == "ascii")
        return self.outcome.plots(PlotLook(min(app.size.width - 4, _WIDEST_PLOTS), glyphs, shades))

    def as_text(self) -> str:
        plots = "\n".join("".join(said for said, _ in line).rstrip() for line in self._plots())
        return self._text() + (f"\n\n{plots}" if plots else "")

    def _text(self) -> str:
        width = min(self.app.size.width - 4, _WIDEST)
        return formatting.folded(self.outcome.text(width), width)

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        match action:
            case "compare":
                return self.outcome.kind in ("replay", "trace")
            case "save":
                return self.outcome.kind != "comparison"
            case "plots":
                return bool(self.outcome.plots(PlotLook(80, choose(), shades=False)))
            case "write_effects" | "load_effects":
                return bool(self.outcome.effects)
            case "write_experiment":
                return bool(self.outcome.experiment)
        return True

    def action_scroll(self, how: str) -> None:
        getattr(self.query_one("#result-room"), f"scroll_{how}")(animate=False)

    def action_plots(self) -> None:
        room = self.query_one("#result-room")
        room.scroll_to(y=0 if room.scroll_y >= min(self._begin_of_plots, room.max_scroll_y) else self._begin_of_plots,
                       animate=False)  # fmt: skip

    @work(exclusive=True, group="compare")
    async def action_compare(self) -> None:
        kept = await in_thread(lambda: comparison.find(self.outcome))
        others = [*reversed(self._others), *kept][:_MOST]
        if not others:
            name = f"no other {self.outcome.kind} to compare with: make one, or save one with s beside this log"
            self.say(name, "wait")
            return
        titles = formatting.apart([made.title for made in others], 46)
        names = [
            title + comparison.length(made.kind, made.document) for title, made in zip(titles, others, strict=True)
        ]
        answers = [Answer(str(n), str(n), name) for n, name in enumerate(names, 1)]
        chosen = await self.app.push_screen_wait(
            ChoiceDialog("Compare with", "B is the result that you choose, A the one that is shown.", answers)
        )
        if chosen is not None:
            other = others[int(chosen) - 1]
            self.app.push_screen(ResultPage(await in_thread(lambda: comparison.comparison(self.outcome, other))))

    def action_leave(self) -> None:
        self.app.pop_screen()

    def action_save(self) -> None:
        made = self.outcome
        self._keep(f"_{made.kind}.json", lambda: json.dumps(made.document, indent=2, allow_nan=False) + "\n", None)

    def action_write_effects(self) -> None:
        effects = self.outcome.effects
        self._keep("_effects.toml", lambda: effects, "e loads them into the live filter")

    def action_write_experiment(self) -> None:
        experiment = self.outcome.experiment
        self._keep("_experiment.toml", lambda: experiment, "Enter takes it")

    @work(exclusive=True, group="keep")
    async def _keep(self, ending: str, make: Callable[[], str], then: str | None) -> None:
        try:
            path = await in_thread(lambda: _kept(self.outcome.log, ending, make()))
        except OSError as error:
            where = error.filename or self.outcome.log.parent
            self.say(f"{where}: {error.strerror or error}. Nothing is written.", "bad")
            return
        self.say(f"wrote {path.name} beside the log" + (f"; {then}" if then else ""), "good")
        if ending == "_experiment.toml":
            self.post_message(requests.OfferProfile(path))

    def action_load_effects(self) -> None:
        name = effect_words.included(log_files.effect_names(self.outcome.effects.encode())) or "no effect"
        self.post_message(requests.LoadEffects(name, self.outcome.effects))


def _kept(log: Path, ending: str, content: str) -> Path:
    if not log.exists() and not log.name.count("_with_"):
        raise FileNotFoundError(errno.ENOENT, "is not there any more: it was renamed or deleted meanwhile", str(log))
    return log_files.keep(log, ending, content)
