"""The terminal UI: a viewer of an acquisition that runs in a process of its own.

It may leave and come back, it may ask (start, stop, record, mark), and it never blocks and never owns data.

What is there: `app` keys and pages · `screens` one page or dialog a module · `widgets` one widget a module · `link` the
acquisition it looks at, `feed` polls it from a thread · `series`, `history` the past of packets and biases · `attempt`
starts an acquisition, `background` calls that may take a while · `palette` every action by name · `pictures` SVG files.

What is said, pure functions: `text` numbers as text of fixed width · `words` states in words · `verdict` the filter's
badge, `explain` at length · `offers`, `recording`, `guiding`, `recordings`, `results` what the Connect, Record, Table,
Logs and result pages say.

How it is drawn: `look` as the configuration asks · `glyphs` what the terminal's font has · `raster`, `lanes`, `bands`
series to cells · `painter` sends only cells that changed · `terminal` what was written and how long it took, `pulse`
frame after frame, `pace` how much is drawn and how often.
"""
