"""Logs of one power-on among those of a trace: joined in order, with one bias and one memory of temperature.

A log carries on from the one it continues only where that is among the logs; else its history is unknown, and that is
said. What it leaves out: how a log says what it continues (`imutui.logbook.power_on`).
"""

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from filters.errors import InputError
from imutui.jobs.runs import LoggedRun
from imutui.logbook import power_on

# a level that is read anew in each part would take what an accelerometer drifts for a tilt; a unit that was turned by
# hand between parts is turned by more
_SAME_ATTITUDE = np.deg2rad(3.0)


def join(reads: Sequence[LoggedRun], numbers: Sequence[int] = ()) -> tuple[list[LoggedRun], list[str]]:
    """Join the logs of each power-on; return all logs in the order given, and sentences on what was joined.

    `numbers`: of each log's power-on, where the caller knows it; none by default.
    Raises InputError if two parts of a power-on overlap in time.
    """
    reads = _parts_of(reads, numbers) if numbers else reads
    before = _preceding(reads)
    notes = [
        f"{read.run.name} continues {read.info.continues}, which is not among the logs: what the unit did before is not"
        " known, and neither its bias nor what it remembers of temperature carries over. Name that log too"
        for number, read in enumerate(reads)
        if read.info.continues_id and number not in before
    ]
    notes += [
        f"{reads[earlier].run.name} is not the file that it was when {reads[number].run.name} was made to continue it"
        for number, earlier in before.items()
        if reads[earlier].sha256 != reads[number].info.continues_sha256
    ]
    made = list(reads)
    for chain in _chains(len(reads), before):
        parts = sorted(chain, key=lambda number: _after_power_on(reads[number]))
        _check_apart([reads[number] for number in parts])
        first = reads[parts[0]]
        for number in parts:
            begins = _after_power_on(reads[number]) - _after_power_on(first)
            run = replace(
                reads[number].run,
                power_on=power_on.log_id(first.info, first.sha256),
                begins=begins,
                history_known=number in before,
            )
            made[number] = replace(reads[number], run=run)
        names = ", then ".join(reads[number].run.name for number in parts)
        notes.append(f"{names}: one power-on in {len(parts)} parts, with one bias and one history of temperature")
        notes += _levelled_once(made, parts)
    return made, notes


def _parts_of(reads: Sequence[LoggedRun], numbers: Sequence[int]) -> list[LoggedRun]:
    """Return logs, in the order of their time, as if each stated which one it continues."""
    made: list[LoggedRun] = []
    for read, number in zip(reads, numbers, strict=True):
        before = [other for other, own in zip(made, numbers, strict=False) if own == number]
        if before:
            last = before[-1]
            info = power_on.continued(read.info, last.info, last.path, last.sha256, before[0].log.first_ns)
            read = replace(read, info=info)
        made.append(read)
    return made


def _preceding(reads: Sequence[LoggedRun]) -> dict[int, int]:
    """Of each log that continues another one among them, by number, that one's."""
    by_id = {power_on.log_id(read.info, read.sha256): number for number, read in enumerate(reads)}
    by_hash = {read.sha256: number for number, read in enumerate(reads)}
    out = {}
    for number, read in enumerate(reads):
        found = by_hash.get(read.info.continues_sha256, by_id.get(read.info.continues_id))
        if read.info.continues_id and found is not None and found != number:
            out[number] = found
    return out


def _chains(count: int, before: dict[int, int]) -> Iterable[list[int]]:
    """Numbers of the logs that hang together, of two or more each."""
    root = list(range(count))
    for _ in range(count):
        root = [root[before[number]] if number in before else root[number] for number in range(count)]
    chains: dict[int, list[int]] = {}
    for number in range(count):
        chains.setdefault(root[number], []).append(number)
    return [chain for chain in chains.values() if len(chain) > 1]


def _after_power_on(read: LoggedRun) -> float:
    """When a log begins, s after the first known sample of its power-on, by its own account."""
    return (read.log.first_ns - (read.info.power_on_ns or read.log.first_ns)) / 1e9


def _check_apart(parts: Sequence[LoggedRun]) -> None:
    for one, two in itertools.pairwise(parts):
        over = _after_power_on(one) + one.run.seconds - _after_power_on(two)
        if over >= 0.0:
            raise InputError(
                f"{one.path} and {two.path} are of one power-on and overlap by {over:.3f} s: a"
                " sample counts once. Leave one of them out, or import again with other --start and --end, each part"
                " with --continues of the one right before it."
            )


def _levelled_once(made: list[LoggedRun], parts: Sequence[int]) -> list[str]:
    """Let parts at rest whose level was read from gravity share the first one's; sentences on those that can't."""
    first = made[parts[0]].run
    if first.C_nb is None:
        return []
    said = []
    for number in parts[1:]:
        run = made[number].run
        if run.C_nb is None:
            continue
        tilt = float(np.arccos(np.clip(first.C_nb[2] @ run.C_nb[2], -1.0, 1.0)))  # between the verticals, rad
        if tilt < _SAME_ATTITUDE:
            made[number] = replace(made[number], run=replace(run, C_nb=first.C_nb))
        else:
            said.append(
                f"{run.name} is tilted by {np.rad2deg(tilt):.1f}° against {first.name}: the unit was moved between"
                " them, and what its level accelerometers do from part to part is not seen"
            )
    return said
