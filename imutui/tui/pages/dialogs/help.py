"""Help in plain language."""

from typing import ClassVar

from textual.binding import Binding, BindingType

from imutui.report import wrapping
from imutui.tui.pages.dialogs.base import ScrollDialog

HELP = """\
FIRST STEPS
  No instrument at hand: 1, then v. A virtual instrument starts, and is
  recorded. With one: 1, choose its port, Enter; then r records.
  4 Filter   wait for "all 6 biases converged". In the demo that takes half
             a minute, the first time on a machine two; AMBER then says that
             that its y gyro oscillates, which t on 6 Logs traces
  r          finishes the file; 3 Record says where it is
  6 Logs     choose the file, t traces it: which physical effect moves
             what the bias does not explain, and how large. Two minutes of
             the demo are enough for that; half an hour is good for a unit

WHAT RUNS WHERE
  The acquisition is a process of its own that owns the port and the file.
  This screen only looks at it: a closed terminal, a lost SSH link or
  Ctrl+Z never costs a sample. `imutui attach` brings the screen back, and
  a second one may look at the same acquisition. The demo, and whatever
  else runs on a virtual unit, ends a minute after its last viewer has
  gone, with the file finished.

PAGES
  0  Rack      the units of a batch, if one is looked at
  1  Connect   choose port, rate, sampling, filter; stop; zero the unit
  2  Live      what the instrument reads: table and plots
  3  Record    what is being written, and who, where, which table
  4  Filter    biases, how sure they are, and what the filter waits for
  5  Table     a table profile, step by step: go to, wait, mark
  6  Logs      recordings: info, check, recover, replay, trace

KEYS ON EVERY PAGE
  1 to 6   the pages; 0 goes back to all units of a batch
  r        start a recording; r again finishes the file. The filter begins
           anew with the file, so that a replay gives the same estimates
  m        put a mark with a text into the recording
  y        copy the numbers of the page as text, to the terminal's clipboard
  d        detach: leave the screen, the acquisition goes on
  q        quit; asks whether the acquisition goes on. Ctrl+C asks as well
  Ctrl+P   all actions by name, with their keys; themes
  Ctrl+Z   back to the shell for a while; `fg` brings the screen back
  Esc      back, cancel, leave a field

ON THE RACK PAGE
  gxyz     a mark a bias: ● has converged, ▲ has not, or something shows,
  axyz     × out of its limit or unexplained, – not known or unobservable
  Enter    the pages of this unit, 2 to 5 that page of it; 0 comes back
  w        worst first. What is wrong stands in full below the list
  x        choose units: keys then act on those alone, else on all
  r m n p  start or finish recordings; one mark, one note, one table
           profile for all
  b t c    begin the table profile; t: the table is there, which serves
           all units that wait for this segment; c cancels, b resumes
  s  S     stop a unit or the chosen ones, after asking; start what does not
           run, perhaps another unit in its place. The others go on

ON THE CONNECT PAGE
  Enter    connect;  Tab next field;  left and right choose in a line
  p  a     ask which instrument is on the chosen port, or on all. That sends
           bytes, so it is never done unasked
  v        the demo
  z        zero the rate sensors; s stop. Both ask first

ON THE LIVE PAGE
  w        Allan deviation, spectrum, histogram of the chosen channel with
           the data sheet's noise; left and right read values, b begins anew
  space    freeze the view; data go on being taken and recorded
  + -      longer or shorter plots;  a lock their scales;  g which plots
  s        scroll, sweep (cheap on a slow link), or numbers only
  counts   what the instrument sent;  value  the same in deg/s, mg and °C
  mean, sd over the last 10 s; min and max show single spikes
  trend    means over the span of the plots as a small line a channel;
           level while they move no more than noise does
  T        steady within ±0.1 K/min, as the badge has it; else the text
           says what to wait for
  plots    every lane has its own scale. A spike is never hidden: each dot
           column spans the lowest to the highest of its samples
  Ctrl+B   a line with what drawing costs: frames, bytes, processor time

ON THE RECORD PAGE
  e        type operator, place, table, note, rotation; Esc is done. They
           go into the file that r begins next
  n        change note and operator of the file that is being written
  rotation the file is finished and the next one begun, none lost between
  losses   packets missing by the instrument's own counter; packets that
           arrived damaged and were dropped; bytes skipped to find the next
  disk     all is flushed every second; LATE means that it is not

ON THE FILTER PAGE
  GREEN    all biases that can be seen have converged, nothing else is left
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

ON THE TABLE PAGE
  p  o     choose a profile of this folder, or type the path of one
  Enter    have the filter go by it; b begins, and records
  Enter    then: the table is there. No clock presses you: the seconds run
           only once you have said so. c cancels, b goes on where it was.
           A virtual unit turns there by itself when you press Enter
  t        traces the finished recording, whose reference the profile is
  s        copies the profile under the cursor to a file. The motion that
           the last trace wants stands first in the list

ON THE LOGS PAGE
  i c v    info, check, recover the file under the cursor
  p        replay: the filter over the recording
  t        trace the file under the cursor, or those chosen with x; one
           file is one power-on. The result page says what was found;
           there, w writes the effects, e loads them into the live filter
  × floor  error of 10 s means over what white noise alone makes of it:
           1 is the best there is
  fits better by   what the likelihood gains (2 ln) less what the
           parameters and their choice cost; a cause joins above 9. A
           rival "fits worse by" so much, or the runs are on its side
  sd apart how far two causes would read from each other in a run that
           the result proposes; 5 are enough
  innovation / its sd   what the filter did not foresee over the standard
           deviation that it stated: 1 is right, above 1 it is too sure
  x        choose for a trace;  n note, R another name, D delete. A log's
           own files go with it, and D asks first
  e        load found effects into the live filter
  o        another folder or file

MOUSE
  Never needed. Hold Shift and drag to select text of the terminal.
"""


_BEGINNING = "Connect"


class HelpDialog(ScrollDialog):
    """Pages, keys and words of the screen in plain language, to scroll.

    `page`: title of the page in front, whose part is on top at first; that of Connect, where one begins, shows the
      first steps.
    """

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("question_mark,f1", "cancel", show=False, priority=True),
    ]

    def __init__(self, page: str = "") -> None:
        super().__init__(wrapping.joined(HELP), "" if page == _BEGINNING else f"ON THE {page.upper()} PAGE")
