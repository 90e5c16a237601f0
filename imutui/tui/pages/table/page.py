"""Table: choose a profile, and be guided through it. The guide's state is the acquisition's."""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from textual.binding import Binding, BindingType
from textual.widget import Widget
from textual.widgets import Input

from imutui.session.client import Client
from imutui.session.snapshot import ProfileDescription, Snapshot
from imutui.tui.connection.model import View
from imutui.tui.pages import requests
from imutui.tui.pages.base import Page
from imutui.tui.pages.dialogs.choice import move_dialog
from imutui.tui.pages.table import text
from imutui.tui.pages.table.chooser import ProfileChooser
from imutui.tui.pages.table.segments import SegmentList

if TYPE_CHECKING:
    from imutui.jobs.operator_steps import Offer

_REQUESTS = {
    "there": ("next", ""),
    "resume": ("resume", "resumed"),
    "cancel": ("cancel", "cancelled; the recording goes on, b resumes"),
}
"""Actions that ask something of the guide: what, and what is said once it has answered."""


_CONDITIONAL = ("take", "other", "begin", "choose", "copy", "trace")


class TablePage(Page):
    """The profiles there are; or the chosen one as a list, with what to do now above it."""

    TITLE = "Table"
    AUTO_FOCUS = "#offers"
    CSS = """
    TablePage #choose, TablePage #follow { height: 1fr; }
    TablePage #choose-lead { padding: 0 1; height: auto; }
    TablePage #offers { height: auto; max-height: 50%; margin: 1 0 0 0; }
    TablePage #other-row { height: 1; padding: 0 1; margin: 1 0 0 0; }
    TablePage #other-row Label { width: 12; }
    TablePage #preview { height: 1fr; padding: 0 1; margin: 1 0 0 0; }
    TablePage #columns { height: 1; color: $foreground 60%; }
    TablePage #detail { height: 2; padding: 0 1; color: $foreground 80%; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("enter", "take", "take it", key_display="enter", tooltip="Have the filter go by this profile"),
        Binding(
            "enter",
            "guide('there')",
            "I am there",
            key_display="enter",
            tooltip="The table is where the profile wants it",
        ),
        Binding("b", "begin", "begin", tooltip="Record, and be guided through the profile"),
        Binding("b", "guide('resume')", "resume", tooltip="Go on with the segment that was cancelled"),
        Binding("c", "guide('cancel')", "cancel", tooltip="Stop being guided; the recording goes on"),
        Binding("t", "trace", "trace", tooltip="Trace what was recorded with this profile, which is its reference"),
        Binding("p", "choose", "other profile", tooltip="Choose another table profile"),
        Binding("s", "copy", "save copy", tooltip="Write the profile under the cursor to a file of another name"),
        Binding("o", "other", "other file", tooltip="Type the path of a profile"),
        Binding("escape", "back", "back", show=False),
    ]

    def __init__(self) -> None:
        super().__init__()
        self._chooser = ProfileChooser()
        self._segments = SegmentList()
        self._known: object = None  # which reference of which acquisition the profile was asked for
        self._choosing = False
        self._offered: set[str] = set()
        self._recorded: Path | None = None
        """File of the last recording that this page saw beside the profile that is followed."""

    def body(self) -> Iterable[Widget]:
        yield self._chooser
        yield self._segments

    def on_mount(self) -> None:
        super().on_mount()
        self._part()
        self.look()

    def on_screen_resume(self) -> None:
        super().on_screen_resume()
        self.look()

    def look(self, wanted: Path | None = None) -> None:
        """Look for profiles; with the cursor on one, if it is there."""
        told = getattr(self.app, "experiment", None)
        experiment = (told.text, told.source) if isinstance(told, requests.ExperimentFound) else None
        self._chooser.look([Path(), self._logs], wanted, experiment)

    @property
    def _logs(self) -> Path:
        return Path(getattr(self.app, "logs_folder", "logs"))

    def offer(self, wanted: Path) -> None:
        """Show the list with the cursor on a profile, whatever is followed."""
        self._choosing = True
        self._part()
        self.look(wanted)

    def on_profile_chooser_written(self, message: ProfileChooser.Written) -> None:
        self.look(message.path)

    # what the acquisition has

    def show(self, view: View) -> None:
        """Show a view; ask for the profile when the acquisition has another one."""
        super().show(view)
        now = view.now
        if now is not None and now["state"] == "running":
            self._ask_for_profile(now)
        if view.recording is not None and self._segments.profile is not None:
            self._recorded = Path(view.recording["path"])
        self._chooser.show(now)
        self._part()
        self._segments.show(now, recorded=self._recorded is not None)

    def _ask_for_profile(self, now: Snapshot) -> None:
        reference = now["reference"]
        key = (now["pid"], reference["name"], reference["file"]) if reference["profile"] else None
        if key == self._known:
            return
        self._known, self._choosing, self._recorded = key, False, None
        self._segments.follow(None)
        if key is not None:
            found: list[ProfileDescription | None] = []

            def ask(client: Client) -> str:
                found.append(client.profile())
                return ""

            self.post_message(self.Ask(ask, "", lambda: self._follow(found[0])))

    def _follow(self, profile: ProfileDescription | None) -> None:
        """A profile has come."""
        self._choosing = False
        self._segments.follow(profile)
        self.redraw()

    @property
    def _follows(self) -> bool:
        """Whether the guided list is shown, not the chooser."""
        return self._segments.profile is not None and not self._choosing

    def _part(self) -> None:
        """Choose, or follow."""
        follows = self._follows
        if self._segments.display != follows or self._chooser.display == follows:
            self._segments.display, self._chooser.display = follows, not follows
            self.query_one("#segments" if follows else "#offers").focus()
        offered = self._possible()
        if offered != self._offered:
            self._offered = offered
            self.refresh_bindings()

    def as_text(self) -> str:
        if self._follows:
            return f"{super().as_text()}\n{self._segments.as_text()}"
        return self._chooser.as_text()

    # what the operator does

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        if action == "guide":
            return parameters[0] in self._possible()
        return action in self._possible() if action in _CONDITIONAL else True

    def _possible(self) -> set[str]:
        """Actions that make sense now."""
        now, profile = self.now, self._segments.profile
        if profile is None or self._choosing:
            return {"take", "other", "copy"}
        if now is None or now["state"] != "running":
            return {"choose"}
        guide = now["guide"]
        under_way = guide is not None and guide["state"] in ("go", "hold")
        can = text.can(guide, now["recording"] is not None) if text.guided(profile, now) else set()
        can -= {"there"} if now["controller"] else set()
        done = now["recording"] is None or (guide is not None and guide["state"] == "done")
        return can | (set() if under_way else {"choose"}) | ({"trace"} if done and self._recorded else set())

    def action_take(self) -> None:
        if not isinstance(self.focused, Input):
            self._chooser.take()

    def on_profile_chooser_chosen(self, message: ProfileChooser.Chosen) -> None:
        """Have the filter go by it; refused while a recording runs, which has one reference."""
        if self.recording is not None:
            self.say("a recording runs: r finishes it, then a profile can be taken", "wait")
        elif message.offer is None:
            self._lay_aside()
        else:
            self._configure(message.offer)

    def _lay_aside(self) -> None:
        """Back from a profile to a unit that stands still and level; the next snapshot shows it."""

        def ask(client: Client) -> str:
            client.configure(reference="level", reference_file=("", ""))
            return f"{text.LEVEL}; the filter began anew"

        self.post_message(self.Ask(ask, "laying the profile aside"))

    def _configure(self, offer: "Offer") -> None:
        def ask(client: Client) -> str:
            client.configure(reference_file=(offer.file, offer.text))
            return f"{offer.name}: {text.TAKEN.get(offer.align, text.TAKEN['marks'])}"

        self.post_message(self.Ask(ask, f"taking {offer.name}", self._taken))

    def _taken(self) -> None:
        """The same profile again is followed as well."""
        self._choosing = False
        self._known = None
        self.redraw()

    def action_guide(self, action: str) -> None:
        do, done = _REQUESTS[action]

        def ask(client: Client) -> str:
            client.guide(do, yes_move=do == "resume")
            return done

        self._when_it_may_move(lambda: self.post_message(self.Ask(ask, "")), asks=do == "resume")

    def action_begin(self) -> None:
        self._when_it_may_move(lambda: self.post_message(requests.BeginGuide(yes_move=True)))

    def _when_it_may_move(self, then: Callable[[], object], *, asks: bool = True) -> None:
        """Do something at once, or, where a table would move by itself, once somebody has said yes."""
        table = self.now["controller"] if self.now is not None else None
        if table is None or not asks or self._segments.profile is None:
            then()
            return
        dialog = move_dialog(table["url"], text.title(self._segments.profile, None))

        def answered(answer: str | None) -> None:
            if answer == "yes":
                then()

        self.app.push_screen(dialog, answered)

    def action_choose(self) -> None:
        self._choosing = True
        self._part()
        self.look()

    def action_copy(self) -> None:
        self._chooser.copy(self._logs)

    def action_trace(self) -> None:
        if self._recorded is not None:
            self.post_message(requests.Trace(self._recorded))

    def action_other(self) -> None:
        self.set_focus(self.query_one("#other"))  # at once: what is typed next goes there

    def action_back(self) -> None:
        """From the field to the list; from the list to the profile that is followed; then to the live page."""
        if isinstance(self.focused, Input):
            self.query_one("#offers").focus()
        elif self._choosing and self._segments.profile is not None:
            self._choosing = False
            self._part()
        else:
            self.app.call_later(self.app.run_action, "live")
