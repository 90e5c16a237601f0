"""The shape in which the past of estimates travels to viewers and stands in a result document.

A record only, so that whoever reads it loads nothing; `estimate_history` fills and uses it.
"""

from typing import TypedDict


class HistoryRows(TypedDict):
    """Extremes of estimates over short spans, a row each, as they travel and are kept in a result document.

    `t` is where a span begins, s since the run's first sample, and `width` its length. `low` and `high` have the least
    and the greatest estimate of each column, `bottom` and `top` the ends of the band of 3 sd, None where nothing is
    known. `converged` says of each column whether it was converged all the time; `newest` is the instant of the last
    estimate.
    """

    t: list[float]
    width: list[float]
    low: list[list[float | None]]
    high: list[list[float | None]]
    bottom: list[list[float | None]]
    top: list[list[float | None]]
    converged: list[list[bool]]
    newest: float | None


class HistorySnapshot(TypedDict):
    """The past of a run of samples, or the next piece of it; `run` tells runs apart.

    `estimates` has gyro biases (deg/s), then accelerometer biases (mg), `temperature` one column in degC. Of what is
    not `complete` there is more: ask with the last `t` of both.
    """

    run: int
    estimates: HistoryRows
    temperature: HistoryRows
    complete: bool
