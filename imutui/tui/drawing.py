"""Drawing: how much and how often, only the cells that changed, and all of it after somebody else has written."""

import os

from imutui.tui.connection.poller import Poller
from imutui.tui.context import AppContext
from imutui.tui.terminal import textual_private
from imutui.tui.terminal.appearance import Appearance
from imutui.tui.terminal.frames import FrameMonitor
from imutui.tui.terminal.pacing import PacingController, is_remote
from imutui.tui.terminal.painter import Painter


class Drawing:
    """Has the page in front drawn at the pace that the terminal keeps up with.

    `context`: what is drawn.
    `appearance`: how much of it, and how often.
    """

    def __init__(self, context: AppContext, appearance: Appearance) -> None:
        self._context = context
        self.frames = FrameMonitor(PacingController(appearance.plot, appearance.fps, remote=is_remote(os.environ)))
        self.painter = Painter()
        textual_private.draw_through(context.app, self.painter.exact)
        context.connection.set_pacing(self.frames.pacing)

    def draw(self, event: Poller.Arrived) -> None:
        """Draw a snapshot if the terminal has taken the last one; only the page in front draws."""
        driver = textual_private.driver_of(self._context.app)
        draws = self.frames.admit(driver, event.snapshot, event.asked_at)
        self._context.connection.set_pacing(self.frames.pacing, self.frames.debug)
        if draws:
            self._context.redraw()

    def cycle_plots(self) -> None:
        """Let plots scroll, or sweep, or be away, or let that be chosen."""
        self._context.connection.set_pacing(self.frames.controller.cycle(), self.frames.debug)
        self._context.redraw()

    def repaint(self, _: object = None) -> None:
        """Draw all of it: nothing of what was drawn is there any more."""
        self.painter.forget()
        for screen in self._context.app.screen_stack:
            screen.refresh(layout=True)
            for widget in screen.walk_children():
                widget.refresh()
