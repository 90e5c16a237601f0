"""The profile that is followed: what to do now, its segments, and what the one under the cursor makes testable."""

from collections.abc import Sequence

from textual import work
from textual.app import ComposeResult
from textual.containers import Vertical
from textual.content import Content
from textual.widgets import Static

from imutui.session.snapshot import GuideSnapshot, ProfileDescription, SegmentDescription, Snapshot
from imutui.tui import formatting
from imutui.tui.background import in_thread
from imutui.tui.connection.model import View
from imutui.tui.pages.base import WIDE
from imutui.tui.pages.table import profiles, text
from imutui.tui.terminal.glyphs import choose
from imutui.tui.widgets.option_rows import OptionRows
from imutui.tui.widgets.text_lines import TextLines

_STYLES = {"now": "bold", "next": "", "done": "dim"}


class SegmentList(Vertical):
    """Head, columns, segments with their state, detail."""

    def __init__(self) -> None:
        super().__init__(id="follow")
        self.profile: ProfileDescription | None = None  # as the acquisition tells it; None without one
        self._testable: Sequence[Sequence[str]] | None = None
        self._guide: GuideSnapshot | None = None
        self._at: int | None = None

    def compose(self) -> ComposeResult:
        yield GuideHead()
        yield Static(id="columns")
        yield OptionRows(id="segments")
        yield Static(id="detail")

    def follow(self, profile: ProfileDescription | None) -> None:
        """Take a profile, then work out what it makes testable."""
        self.profile, self._testable, self._at = profile, None, None
        self.query_one(GuideHead).profile = profile
        if profile is not None:
            self._work_out(profile)

    @work(exclusive=True, group="testable")
    async def _work_out(self, profile: ProfileDescription) -> None:
        testable = await in_thread(lambda: profiles.makes_testable(profile))
        if self.profile is profile:
            self._testable = testable
            self._list()

    def show(self, now: Snapshot | None, *, recorded: bool = False) -> None:
        self.query_one(GuideHead).recorded = recorded
        self._guide = now["guide"] if now is not None else None
        self._list()

    def _list(self) -> None:
        if self.profile is None or not self.query("#segments"):
            return
        segments, guide = self.profile["segments"], self._guide
        rows = self.query_one("#segments", OptionRows)
        rows.fill([self._line(number) for number in range(len(segments))])
        at = min(guide["segment"], len(segments) - 1) if guide is not None else None
        if at is not None and at != self._at:
            rows.highlighted = at
        self._at = at
        self.query_one("#columns", Static).update(Content(self._columns()))
        self._say_detail()

    def _line(self, number: int) -> Content:
        assert self.profile is not None
        line = text.segment(self.profile["segments"][number], number, self._guide, self._room())
        if self.app.size.width >= WIDE:
            line += f" {text.testable(self._testable_in(number), self.app.size.width - len(line) - 3)}"
        style = _STYLES.get(text.state_word(self._guide, number), "")
        return Content.styled(choose().text(line), style)

    def _testable_in(self, number: int) -> Sequence[str] | None:
        """What a segment makes testable; None while that is worked out."""
        return None if self._testable is None else self._testable[number]

    def _room(self) -> int:
        """Characters for what to do."""
        return 41 if self.app.size.width >= WIDE else self.app.size.width - 41

    def _columns(self) -> str:
        line = f"  #  {'what to do':<{self._room()}}    dwell  state      left    marked "
        return line + (" makes testable" if self.app.size.width >= WIDE else "")

    def on_option_list_option_highlighted(self) -> None:
        self._say_detail()

    def _say_detail(self) -> None:
        """The cursor's segment, in as many words as there is room for."""
        at = self.query_one("#segments", OptionRows).cursor
        if at is None or self.profile is None:
            return
        head = f"Segment {at + 1} makes testable: "
        said = text.testable(self._testable_in(at), 2 * (self.app.size.width - 3) - len(head))
        self.query_one("#detail", Static).update(Content(choose().text(head + said)))

    def as_text(self) -> str:
        return f"{self._columns()}\n{self.query_one('#segments', OptionRows).as_text()}"


_BAR = 30


class GuideHead(TextLines):
    """Which profile, what to do now, what then, and how long still; always as high, so that the list below stays."""

    DEFAULT_CSS = "GuideHead { height: 6; padding: 0 1; }"

    profile: ProfileDescription | None = None  # as the acquisition tells it
    recorded = False  # whether there is a recording of it

    def lines(self, view: View, width: int) -> list[Content]:
        """Title, instruction, what then, bar; or, before it begins, what to know of a virtual unit."""
        if self.profile is None or view.now is None:
            return []
        guide, segments = view.now["guide"], self.profile["segments"]
        by_hand = text.guided(self.profile, view.now)
        ended, table = view.now["state"] == "ended", view.now["controller"] if by_hand else None
        what, then = (
            text.ENDED
            if ended
            else text.said(guide, self.profile, view.recording is not None, by_hand, self.recorded, table is not None)
        )
        about = " ".join(self.profile["about"])
        seconds = sum(s["seconds"] for s in segments)
        warned = text.warning(view.now, width) if by_hand and not ended else []
        return [
            self.line((text.title(self.profile, seconds), "bold")),
            self.line((formatting.shorten(about, width - 2), "dim")),
            self.line((what, "bold reverse" if guide and guide["state"] == "go" and not ended else "bold")),
            self.line(then),
            *(self.line(said) for said in warned),
            *([] if warned or ended else [self._bar(guide, segments)]),
            *([self.line(formatting.shorten(text.table_line(table), width - 2))] if table else []),
        ]

    def _bar(self, guide: GuideSnapshot | None, segments: list[SegmentDescription]) -> Content:
        if guide is None or guide["state"] not in ("go", "hold"):
            return self.line("")
        seconds = segments[guide["segment"]]["seconds"]
        left = text.left(guide, guide["segment"])
        if left is None:
            return self.line(f"{text.bar(0.0, _BAR)}  then {seconds:.0f} s")
        share = 1.0 - left / seconds if seconds > 0.0 else 1.0
        return self.line(f"{text.bar(share, _BAR)}  ", (f"{left:3.0f} s left", "bold"), f" of {seconds:.0f} s")
