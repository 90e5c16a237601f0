"""A gauge: where a value and its certainty lie between two limits, in characters. A pure function."""

CELLS = 11


def gauge(value: float | None, limit: float, sd3: float | None = None) -> str:
    """Bar from zero in the middle to the value; ░ where three standard deviations reach; ▲ at the end beyond a limit.

    `value`: what is shown; None for not known.
    `limit`: of the data sheet, at both ends.
    `sd3`: three standard deviations; None for not known.
    """
    middle = CELLS // 2
    cells = ["·"] * CELLS
    if value is not None:
        if sd3 is not None:
            low, high = _cell(value - sd3, limit), _cell(value + sd3, limit)
            cells[middle + low : middle + high + 1] = "░" * (high - low + 1)
        end = _cell(value, limit)
        first, last = min(end, 0), max(end, 0)
        cells[middle + first : middle + last + 1] = "█" * (last - first + 1)
        if abs(value) > limit:
            cells[middle + (middle if value > 0 else -middle)] = "▲"
    cells[middle] = "│"
    return f"▕{''.join(cells)}▏"


def _cell(value: float, limit: float) -> int:
    """Cell of a value, counted from the middle; the outermost for what is beyond."""
    middle = CELLS // 2
    reach = min(abs(value) / limit * middle, middle)
    cells = int(reach + 0.5)
    return cells if value > 0 else -cells
