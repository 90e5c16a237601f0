"""The terminal UI: a viewer of an acquisition that runs in a process of its own.

It may leave and come back, it may ask (start, stop, record, mark), and it never blocks and never owns data.

What is there: `app` keys and pages, `context` what its parts share · `connecting`, `recording`, `drawing` what keys
and pages ask for · `connection` the acquisition as the screen sees it · `terminal` what is sent to it, and how it
looks · `widgets` what several pages show · `pages` one folder a page: `page`, its own widgets, and `text`, what it
says, as pure functions · `messages` states in words, `formatting` numbers and paths as text · `background` calls that
may take a while.
"""
