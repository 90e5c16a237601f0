"""Recordings made elsewhere, as logs; docs/importing.md.

`table` a file as named columns in pieces · `text` CSV of any dialect · `arrays` NPZ, NPY and Parquet · `columns`
decides which column is which channel, and in which unit · `rows` puts rows in order of time and finds bad stamps ·
`scale` finds units that the numbers contradict · `recording` is the result, read once and checked ·
`write` makes the log.
"""
