"""Rules of `check` on the packets that the unit sent: losses on the line, and its time counter."""

from collections.abc import Iterator

import numpy as np

from imutui.instrument.registry import of_model
from imutui.jobs.check_context import CheckContext, Finding, integer, is_polled, lossy
from imutui.jobs.check_times import Places, StepCounts, median
from imutui.jobs.quantities import plural, that_many
from imutui.logbook import line_advice, scan, schemas
from imutui.logbook.audit import Audit, Part

_FEW, _SHARE = 2, 0.1
_SURELY_MORE = 1.7
_NOT_COUNTED = schemas.FLAG_LOST_BEFORE | schemas.FLAG_HOST_STAMP
_TICKS, _IN_ORDER, _LOST_BEFORE, _COUNTED = 0xFFFF, 1 << 16, 1 << 17, 1 << 18
"""What goes with a step: the counter's, and what is said of the packet at its end."""


class PacketSteps:
    """What was lost on the line, and whether the unit's time counter goes on evenly."""

    def __init__(self, known: Audit) -> None:
        self._polled = is_polled(known)
        self._counter_spec = of_model("" if known.info is None else known.info.instrument).counter
        self._off = Places()
        self._last_number: int | None = None
        self._steps = StepCounts()
        self._held_up = _HeldUp()
        self._last: list[np.ndarray] = []

    def take(self, part: Part) -> None:
        """Look at the next part."""
        heads = part.packet_heads
        if heads is None or not heads.size:
            return
        flags = part.packets["flags"]
        self._held_up.take(heads["log_ns"], heads["publish_ns"], flags)
        numbers = part.packets["sequence"].astype(np.int64)
        before = numbers[0] - 1 if self._last_number is None else self._last_number
        self._off.take(heads["publish_ns"], np.diff(numbers, prepend=before) != 1)
        self._last_number = int(numbers[-1])
        if self._polled:
            return
        rows = heads["publish_ns"], heads["sequence"].astype(np.int64), part.packets["ticks"].astype(np.int64), flags
        joined = [np.concatenate(pair) for pair in zip(self._last, rows, strict=True)] if self._last else list(rows)
        self._last = [row[-1:] for row in joined]
        stamps, sequence, ticks, flags = joined
        self._steps.take(np.diff(stamps.astype(np.float64)), self._codes(sequence, ticks, flags), stamps)

    def findings(self, log: CheckContext) -> Iterator[Finding]:
        """What it found."""
        yield from self._line(log)
        yield from self._counter(log)
        # where a file is damaged, or was rebuilt, that says more
        if self._off.count and log.paired and not lossy(log.found) and scan.RECOVERED not in log.audit.metadata:
            places = plural(self._off.count, "place")
            what = f"The packets' numbers do not go on by one in {places}: some are missing, or changed."
            cure = "Trust no more than a copy that has its own sum (.sha256)."
            yield Finding("packets", what, f"first {log.at(self._off.first_ns)}", cure)

    def _line(self, log: CheckContext) -> Iterator[Finding]:
        """What was lost on the line, by the recorder's count and by the packets themselves."""
        keys = ("lost_packets", "bad_checksums", "doubled_packets")
        told = {key: integer(log.audit.diagnostics.get(key)) for key in keys}
        certain = told["lost_packets"]
        most = max(certain, integer(log.audit.diagnostics.get("lost_packets_max")))
        lost, where = self._lost_packets(log)
        if lost or most:
            what = _how_many(certain, most) if most else f"{that_many(lost, 'packet', 'was', 'were')} lost on the line."
            slack = max(_FEW, _SHARE * most)
            differ = not certain - slack <= lost <= most + slack
            if log.paired and not log.polled and differ and not lossy(log.found):
                what = (
                    f"{_how_many(certain, most)[:-1]} by the recorder's count, {lost:,} by the times of those that"
                    " are there."
                )
            held_up = log.paired and self._held_up.mostly
            yield Finding("lost", what, where, _where_to_look(log, held_up=held_up))
        if told["bad_checksums"]:
            what = f"{that_many(told['bad_checksums'], 'packet', 'was', 'were')} dropped: the checksum was wrong."
            yield Finding("checksums", what, "by the recorder's count", _where_to_look(log))
        if told["doubled_packets"]:
            what = f"{that_many(told['doubled_packets'], 'packet', 'was', 'were')} received twice, and used once."
            yield Finding("doubled", what, "by the recorder's count", _DOUBLED)

    def _codes(self, sequence: np.ndarray, ticks: np.ndarray, flags: np.ndarray) -> np.ndarray:
        """What goes with the steps between packets, int64, shape (n - 1,)."""
        in_order, flags = np.diff(sequence) == 1, flags[1:]
        counted = in_order & ((flags & _NOT_COUNTED) == 0)
        steps = self._counter_spec.step(ticks[:-1], ticks[1:])
        codes = np.where(counted, steps | _COUNTED, 0)
        lost = (flags & schemas.FLAG_LOST_BEFORE) > 0
        return np.asarray(codes | in_order * _IN_ORDER | lost * _LOST_BEFORE)

    def _tells(self, log: CheckContext) -> bool:
        """Whether the packets' times can tell anything."""
        return log.paired and log.audit.packets >= 3 and not self._polled

    def _lost_packets(self, log: CheckContext) -> tuple[int, str]:
        """Packets missing between those of a stream by the times of those that are there, and where first."""
        if not self._tells(log):
            return 0, "by the recorder's count"
        table = self._steps
        period = self._mean_step()
        # what the file itself lost is told by the messages' numbers
        inside, flagged = table.codes & _IN_ORDER > 0, table.codes & _LOST_BEFORE > 0
        # a line that sets the pace makes steps of one and of two periods of the unit's loop; and the recorder flags all
        # losses, while its first stamps may still move
        surely = 2.0 * _SURELY_MORE
        periods = np.rint(table.steps / max(period, 1.0))
        missing = np.where(inside & (flagged | (table.steps > surely * period)), periods - 1.0, 0.0)
        places = missing > 0
        if not places.any():
            return 0, "by the recorder's count"
        first = log.at(int(table.before_ns[table.first(places)]))
        count = int(table.counts[places].sum())
        return int((missing * table.counts).sum()), f"in {plural(count, 'place')}, first {first}"

    def _mean_step(self) -> float:
        """Mean step from packet to packet where none is missing, ns."""
        steps, counts = self._steps.steps, self._steps.counts
        usual = steps < _SURELY_MORE * self._steps.median()
        if not usual.any():
            return float("nan")
        return float((steps * counts)[usual].sum() / counts[usual].sum())

    def _counter(self, log: CheckContext) -> Iterator[Finding]:
        """Whether the unit's time counter goes on evenly, and the packets' own numbers."""
        if not self._tells(log):
            return
        table = self._steps
        contiguous = (table.codes & _COUNTED > 0) & (table.steps < 1.5 * self._mean_step())
        if table.counts[contiguous].sum() < 3:
            return
        ticks = table.codes & _TICKS
        usual = median(ticks[contiguous], table.counts[contiguous])
        twice = contiguous & (ticks == 0) & (usual > 0)
        if twice.any():
            what = f"{that_many(int(table.counts[twice].sum()), 'packet', 'stands', 'stand')} twice: its counter is the"
            where = f"first {log.at(int(table.after_ns[table.first(twice)]))}"
            yield Finding("doubled", f"{what} one of the packet before.", where, _DOUBLED)
        off = contiguous & ~twice & (np.abs(ticks - usual) > 0.6 * usual)
        if off.any():
            count = int(table.counts[off].sum())
            what = f"The unit's time counter jumps in {plural(count, 'place')} without a packet missing."
            where = f"first {log.at(int(table.after_ns[table.first(off)]))}"
            yield Finding("counter", what, where, "Check the unit's supply: it may have begun anew.")


_DOUBLED = "Look at what lies between unit and computer: an adapter, a splitter or a server sends packets again."


class _HeldUp:
    """Whether most losses follow at once on packets that were read late."""

    def __init__(self) -> None:
        self._last_late = np.iinfo(np.int64).min // 2
        self._lost = 0
        self._near = 0

    def take(self, read: np.ndarray, stamps: np.ndarray, flags: np.ndarray) -> None:
        """More packets: when they were read and sampled, UTC, ns, and their flags."""
        late = read - stamps > line_advice.HELD_UP_S * 1e9
        last_late = np.maximum.accumulate(np.where(late, read, self._last_late))
        lost = (flags & schemas.FLAG_LOST_BEFORE) > 0
        self._lost += int(np.count_nonzero(lost))
        self._near += int(np.count_nonzero((read - last_late)[lost] < line_advice.NEAR_S * 1e9))
        self._last_late = int(last_late[-1])

    @property
    def mostly(self) -> bool:
        """Whether it is so."""
        return 2 * self._near > self._lost


def _how_many(certain: int, most: int) -> str:
    if certain == most:
        return f"{that_many(certain, 'packet', 'was', 'were')} lost on the line."
    return f"Between {certain:,} and {most:,} packets were lost: while the line was silent the unit may have sent some."


def _where_to_look(log: CheckContext, *, held_up: bool = False) -> str:
    info = log.audit.info
    port, firmware = (info.port, info.firmware) if info is not None else ("", "")
    return line_advice.of_losses(port, firmware, held_up=held_up)
