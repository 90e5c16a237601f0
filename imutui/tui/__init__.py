"""The terminal UI: a viewer of an acquisition that runs in a process of its own.

It may leave and come back, it may ask (start, stop, record, mark), and it never blocks and never owns data.

`app` keys and pages · `link` the acquisition it looks at · `series` its past · `feed` polls it from a thread ·
`attempt` starts one · `background` calls that may take a while · `words` states said in words ·
`text` numbers as text · `raster` series to cells · `glyphs` what the terminal's font has ·
`palette` every action by name · `offers` what the connect page offers · `screens` one page or dialog a module ·
`widgets` one widget a module.
"""
