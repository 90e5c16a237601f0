"""Help in plain language."""

from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import VerticalScroll
from textual.content import Content
from textual.screen import ModalScreen
from textual.widgets import Static

from imutui.tui.glyphs import choose

HELP = """\
imutui reads an IMU on a turn table, records it, and estimates its biases.

The acquisition runs in a process of its own that owns the port and the
file. This screen only looks at it: closing the terminal, a lost SSH link
or Ctrl+Z never costs a sample. `imutui attach` brings the screen back.

PAGES
  1  Connect   choose port, rate and sampling
  2  Live      what the instrument reads: table and plots
  3  Filter    biases, how sure they are, and what the filter waits for

KEYS
  r        start a recording; r again finishes the file. The filter starts
           anew with the file, so that a replay gives the same estimates
  m        put a mark with a text into the recording
  space    freeze the view; data go on being taken and recorded
  + -      longer or shorter plots
  a        lock the plots' scales, or let them follow the data
  g        the other plot: gyro or accel (tall terminals show both on Live)
  d        detach: leave the screen, the acquisition goes on
  q        quit; asks whether the acquisition goes on. Ctrl+C asks as well
  Esc      back, cancel
  Ctrl+P   all actions by name, themes, screenshot
  Ctrl+Z   suspend this screen; `fg` brings it back

ON THE LIVE PAGE
  counts   what the instrument sent
  value    the same in deg/s, mg and °C
  mean, sd over the last 10 s; min and max show single spikes
  plots    every lane has its own scale. A spike is never hidden: each dot
           column spans the lowest to the highest of its samples
  lost     packets missing, by the instrument's own counter
  bad sums packets that arrived damaged and were dropped

ON THE FILTER PAGE
  GREEN    all biases that can be seen have converged, nothing is unexplained
  AMBER    wait, or look: the text says at what. RED: do what it says
  w        why: every rule of the badge with what it found, all alarms
  up down  choose a bias; Enter enlarges its plot, a changes its scale
  t        trace this recording: look for what the model does not explain
  e        load found effects into the filter
  ±3 sd    the true bias is within, if the filter's model is right
  bar      zero in the middle; the ends are the data sheet's limit
  in 10 s  how far the estimate moved, in its own sd too if that is much
  unobservable   this setup cannot tell this bias from something else
  unexplained    means over 10 s of what the estimate leaves, over what
           noise allows: 1 is noise, above 2 something is there
  NIS      how surprising the measurements are. A number near its degrees
           of freedom is right, if it is a test at all; the page says so
  gates    measurements left out because they were impossible
  A bias is what a still unit reads too much: corrected = reading − bias

MOUSE
  Never needed. Hold Shift and drag to select text of the terminal.
"""


class HelpDialog(ModalScreen[None]):
    """Text to scroll."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape,q,question_mark,f1,ctrl+c", "dismiss_help", "close", priority=True),
        Binding("j", "down", show=False),
        Binding("k", "up", show=False),
    ]

    def compose(self) -> ComposeResult:
        """The text."""
        with VerticalScroll(classes="dialog help"):
            yield Static(Content(choose().text(HELP)))
            yield Static(Content.styled("arrows scroll, Esc closes", "dim"))

    def action_dismiss_help(self) -> None:
        """Close."""
        self.dismiss(None)

    def action_down(self) -> None:
        """Scroll as in vi."""
        self.query_one(VerticalScroll).scroll_down()

    def action_up(self) -> None:
        """Scroll as in vi."""
        self.query_one(VerticalScroll).scroll_up()
