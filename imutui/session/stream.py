"""The stream of an acquisition: blocks of stamped packets, what comes between them, what is said, and seconds.

The reader makes blocks (`Stamper`). Every consumer takes every event, in the order of `acquisition.Acquisition`'s list.
"""

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, replace
from enum import Enum, auto
from typing import NamedTuple, Protocol, TypeAlias

import numpy as np
import numpy.typing as npt

from filters.motion.profile import Profile
from filters.motion.reference import Trajectory
from imutui.instrument.clock import Clock, Gap, Stamp
from imutui.instrument.counts import DataPacket
from imutui.logbook.session_info import SessionInfo
from imutui.session.reconnection import LineLost, LineReturned, StillAway

INFORMATION, WARNING, ERROR = 20, 30, 40  # levels of what is said, as /rosout has them

ROW = np.dtype(
    [
        ("counts", np.int64, 7),  # rates, accelerations, temperature; instrument axes
        ("ticks", np.int64),  # the unit's counter
        ("host_ns", np.int64),  # when its last byte was read, monotonic
        ("stamp_ns", np.int64),  # when it was sampled, monotonic
        ("uncertainty_ns", np.int64),  # how far from the truth the stamp may be
        ("by_host", np.bool_),  # whether the stamp is the time of arrival less the line's time
        ("requested_ns", np.int64),  # when it was asked for, monotonic; 0 if it came by itself
        # in counts, 0 if the packet has no details
        ("rate_temperatures", np.int64, 3),
        ("board_temperature", np.int64),
        ("status", np.int64),
    ]
)
"""A packet of a block."""
_NO_DETAILS = ((0, 0, 0), 0, 0)


class PacketArrival(NamedTuple):
    """A packet as it was read."""

    packet: DataPacket
    host_ns: int  # when its last byte was read, monotonic
    contiguous: bool  # whether it followed the packet before byte by byte
    quiet: bool  # whether the line was found without a byte since the packet before
    behind: bool  # whether more had arrived already when it was read
    # of the line so far; doubled packets came a second time
    bad_checksums: int
    discarded_bytes: int
    doubled: int = 0
    requested_ns: int | None = None  # when it was asked for; None if it came by itself


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """Packets in a row, with nothing between them; `gap` and the counts are of the line before the first one."""

    rows: np.ndarray  # of `ROW`
    gap: Gap | None = None
    bad_checksums: int = 0
    discarded_bytes: int = 0
    doubled: int = 0

    def cut(self, count: int) -> "tuple[Block, Block]":
        """Return the first packets, so many of them, and the others."""
        return replace(self, rows=self.rows[:count]), Block(self.rows[count:])


class Stamper:
    """Makes blocks of packets: the clock stamps them, some only once later ones have come. Not thread-safe."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._unstamped = deque[PacketArrival]()
        self._line = (0, 0, 0)
        self._rows = list[tuple[object, ...]]()
        self._before: tuple[Gap | None, int, int, int] = (None, 0, 0, 0)
        self._blocks = list[Block]()

    def take(self, arrival: PacketArrival) -> None:
        """Take the next packet."""
        self._unstamped.append(arrival)
        stamps = self._clock.take(
            arrival.packet.ticks,
            arrival.host_ns,
            contiguous=arrival.contiguous,
            quiet=arrival.quiet,
            behind=arrival.behind,
            requested_ns=arrival.requested_ns,
        )
        self._join(stamps)

    def due(self, now_ns: int) -> None:
        """Stamp the packets that waited for others long enough; all that came until `now_ns` has been taken."""
        if self._unstamped:
            self._join(self._clock.due(now_ns))

    def release(self) -> None:
        """Stamp the packets that wait, by what is known."""
        self._join(self._clock.release())

    def interrupt(self, *, lossy: bool = False) -> None:
        """Begin a new stretch with the next packet, see `Clock.interrupt`."""
        self._join(self._clock.interrupt(lossy=lossy))

    def blocks(self) -> list[Block]:
        """Return the blocks since the last call."""
        self._close()
        blocks, self._blocks = self._blocks, []
        return blocks

    def _join(self, stamps: list[Stamp]) -> None:
        for stamp in stamps:
            packet, host_ns, _, _, _, bad, discarded, doubled, requested_ns = self._unstamped.popleft()
            if stamp.gap is not None or (bad, discarded, doubled) != self._line:
                self._close()
                line, self._line = self._line, (bad, discarded, doubled)
                self._before = (stamp.gap, bad - line[0], discarded - line[1], doubled - line[2])
            more = packet.details
            details = (
                ((0, 0, 0), 0, 0) if more is None else (more.rate_temperatures, more.board_temperature, more.status)
            )
            self._rows.append(
                (
                    (*packet.rates, *packet.accels, packet.temperature),
                    packet.ticks,
                    host_ns,
                    stamp.monotonic_ns,
                    stamp.uncertainty_ns,
                    stamp.by_host,
                    requested_ns or 0,
                    *details,
                )
            )

    def _close(self) -> None:
        if self._rows:
            self._blocks.append(Block(np.array(self._rows, ROW), *self._before))
            self._rows, self._before = [], (None, 0, 0, 0)


class Why(Enum):
    """Why packets on either side do not belong together, though none is known to be lost between them."""

    UNANSWERED = auto()  # a poll whose answer certainly does not come any more
    ZEROED = auto()  # the rate sensors were zeroed, or may have been


class Broke(NamedTuple):
    """The stream broke. A gap before a block, and a line that returned (`LineReturned`), break it as well."""

    why: Why


class Began(NamedTuple):
    """A new run of samples begins with the next packet, as the first one of a new recording or not."""

    recording: bool


class Said(NamedTuple):
    """An event or a mark of the operator ("mark", or "remark" while a guide is under way)."""

    name: str
    text: str
    level: int = INFORMATION
    at_ns: int = 0  # monotonic; `Acquisition.event` sets it


@dataclass(frozen=True, slots=True)
class Second:
    """A second has passed: what there is to look at."""

    now_ns: int  # monotonic
    written_ns: int  # log time of a message that is written now, monotonic
    silent_s: float  # since the last packet
    pauses: bool  # whether no packet is expected now
    accels_g: npt.NDArray[np.float64] | None  # mean of the accelerometers, instrument axes; None before any packet
    # info, motion: as they are in force
    info: SessionInfo
    motion: Profile | Trajectory | None


Event: TypeAlias = Block | Broke | LineLost | StillAway | LineReturned | Began | Said | Second


class Consumer(Protocol):
    """Takes every event of an acquisition."""

    def take(self, event: Event, /) -> Iterable[Said]:
        """Take an event; returns what is to be said of it."""
