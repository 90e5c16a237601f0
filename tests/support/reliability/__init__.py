"""What is expected of an acquisition when something goes wrong: each function makes it happen and measures what came.

The tests hold the figures to generous limits, `benchmarks/reliability.py` prints them beside the bars.
"""
