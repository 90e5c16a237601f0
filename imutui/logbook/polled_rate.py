"""Whether polling keeps the rate that was asked for, and what to say if it does not; for recordings and for logs."""

from dataclasses import dataclass

_SHARE = 0.95
RARE = 0.1  # share of answers that may be late before that is how the unit is
FEWEST = 5  # requests from which a rate can be told


class PolledRate:
    """Requests a second, of a unit that answers.

    Time in which the unit was silent or away is left out, and so are the few answers that came late: those are other
    matters, and said as such.

    `rate_hz`: asked for.
    """

    def __init__(self, rate_hz: float) -> None:
        self._rate_hz = rate_hz
        self._last_ns: int | None = None
        self._unanswered = 0
        self._usual, self._long = _Steps(), _Steps()

    def answered(self, requested_ns: int) -> None:
        """Take note of a request that was answered; of all of them, in order."""
        if self._last_ns is not None:
            step_s = (requested_ns - self._last_ns) * 1e-9
            if step_s <= usual_step_s(self._rate_hz):
                self._usual.add(step_s, 1 + self._unanswered)
            elif not self._unanswered or step_s <= longest_step_s(self._rate_hz):
                self._long.add(step_s, 1 + self._unanswered)
        self._last_ns, self._unanswered = requested_ns, 0

    def unanswered(self) -> None:
        """Take note of a request that was not."""
        self._unanswered += 1

    def interrupt(self) -> None:
        """Take note that there was a pause since the last request."""
        self._last_ns, self._unanswered = None, 0

    def finding(self) -> str | None:
        """What to say if the rate is not kept; None if it is, or while that cannot be told."""
        usual, long = self._usual, self._long
        rare = long.count <= RARE * (usual.count + long.count)
        requests = usual.requests + (0 if rare else long.requests)
        seconds = usual.seconds + (0.0 if rare else long.seconds)
        return finding(self._rate_hz, requests / seconds) if requests >= FEWEST else None


@dataclass(slots=True)
class _Steps:
    """Steps from one answered request to the next, and requests in them."""

    count: int = 0
    requests: int = 0
    seconds: float = 0.0

    def add(self, seconds: float, requests: int) -> None:
        self.count += 1
        self.requests += requests
        self.seconds += seconds


def usual_step_s(rate_hz: float) -> float:
    """Time between two requests above which the answer to the first was late, s."""
    return 3.5 / rate_hz


def longest_step_s(rate_hz: float) -> float:
    """Time between two answers above which the unit was silent between them, s."""
    return max(1.0, 3.0 / rate_hz)


def finding(asked_hz: float, measured_hz: float | None) -> str | None:
    """What to say of a rate that is not kept; None if it is, give or take a twentieth, or if it is not known."""
    if measured_hz is None or measured_hz >= _SHARE * asked_hz:
        return None
    return (
        f"{asked_hz:g} Hz were asked for, {measured_hz:.3g} Hz came: a request and its answer take longer than the"
        " period. Ask for a lower rate, raise the line speed (--baud), or stream (--sampling stream)."
    )
