"""Biases of rows as values with a unit, a power-on and a time: what a fleet's statistics are made of."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, cast

from filters.channels import CHANNELS
from imutui.jobs.campaign.rows import Row
from imutui.jobs.campaign.summary_document import MONTH_DAYS, PartsField

if TYPE_CHECKING:
    from filters.fleet.components import Component, Fleet
    from filters.fleet.mixture import Estimate
    from filters.fleet.readings import Repeatability

MOST_SD = {"deg/s": 0.5, "mg": 6.0}
"""A third of the standard deviation that the filter begins with: above, a bias is still drawn to the first guess."""
_SECONDS = 86400.0
_MOST_OF_SITE = 1.0 - 1e-9
"""Largest part of a standard deviation that an unstated site can be: the filter's own is never zero."""


@dataclass(frozen=True, slots=True)
class BiasValue:
    """A bias of a log."""

    row: Row  # what it is of
    # value, sd: deg/s or mg
    value: float
    sd: float
    converged: bool  # whether the filter's estimate had settled
    site_sd: float = 0.0  # part of `sd`, in quadrature, that an unstated site adds; mg

    @property
    def own_sd(self) -> float:
        """Standard deviation of a difference to a log from the same place, as far as this log adds to it."""
        return math.sqrt(self.sd**2 - self.site_sd**2)


@dataclass(frozen=True, slots=True)
class ChannelValues:
    """All values of a channel, and of how many logs there is none, and why."""

    channel: str
    unit: str
    values: tuple[BiasValue, ...]
    unobservable: int
    unmeasured: int


def channels(rows: Sequence[Row]) -> Iterator[ChannelValues]:
    """Biases of the six channels; every row has a result."""
    for number, channel in enumerate(CHANNELS):
        axis, gyro = number % 3, number < 3
        unit = "deg/s" if gyro else "mg"
        every = [_value(row, axis, gyro) for row in rows]
        seen = [one for one in every if one is not None]
        measured = tuple(one for one in seen if one.sd <= MOST_SD[unit])
        yield ChannelValues(channel, unit, measured, len(every) - len(seen), len(seen) - len(measured))


def _value(row: Row, axis: int, gyro: bool) -> BiasValue | None:
    final, sds = row["final"], row["sd"]
    assert final is not None
    assert sds is not None
    value = (final["gyro_bias_dps"] if gyro else final["accel_bias_mg"])[axis]
    sd = (sds["gyro_bias_dps"] if gyro else sds["accel_bias_mg"])[axis]
    if value is None or sd is None or sd <= 0.0:
        return None
    found = row["converged_s"]
    since = None if found is None else (found["gyro_bias"] if gyro else found["accel_bias"])[axis]
    site_sd = 0.0 if gyro else (row["site_sd_mg"] or (0.0,) * 3)[axis]
    return BiasValue(row, value, sd, since is not None, min(site_sd, _MOST_OF_SITE * sd))


def power_on(row: Row) -> str:
    """Id of a row's power-on; a log that states none is one of its own."""
    return row["power_on"] or f"log {row['log']}"


def months(start_utc: str | None) -> float | None:
    """A time as months since 1970; None where there is none or it is not ISO."""
    try:
        moment = datetime.fromisoformat(start_utc or "")
    except ValueError:
        return None
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp() / (_SECONDS * MONTH_DAYS)


def field(found: "Estimate | Component | Repeatability | None") -> Any:
    """An estimate of `filters.fleet` as a summary has it, where its fields have the same names."""
    return None if found is None else asdict(found)


def parts(fleet: "Fleet | None") -> PartsField:
    """What belongs to model, unit and day; all None where there was no value."""
    return cast("PartsField", {name: field(getattr(fleet, name, None)) for name in PartsField.__annotations__})
