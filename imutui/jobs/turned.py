"""A trace of logs of a unit that was turned by hand: from readings alone, since the motion is not known.

What it leaves out: the method (`filters.multiposition`), and reading the logs (`imutui.jobs.runs`).
"""

from collections.abc import Callable, Sequence

from filters.errors import InputError
from filters.tracing.result import Trace
from imutui.jobs.runs import LoggedRun

KIND = "turned"


def is_turned(reads: Sequence[LoggedRun]) -> bool:
    """Whether logs are of a unit turned by hand.

    Raises InputError if some are and some are not.
    """
    turned = [read for read in reads if read.info.reference == KIND]
    others = [read for read in reads if read.info.reference != KIND]
    if turned and others:
        raise InputError(
            f"{turned[0].path} was turned by hand (reference turned) and {others[0].path} was not (reference"
            f" {others[0].info.reference}): their errors are of different kinds. Trace them apart; effects of the one"
            " can be given to the filter on the other (-o FILE, imutui replay --effects FILE)."
        )
    return bool(turned)


def trace_turned(
    fitted: Sequence[LoggedRun],
    held: LoggedRun | None,
    asked: Sequence[str],
    seed: int,
    progress: Callable[[float, str], None],
) -> tuple[Trace, list[str]]:
    """Trace logs of a unit turned by hand, and notes on them.

    `fitted`: each a power-on.
    `held`: nothing is fitted to it.
    `asked`: effects whose smallest visible size is wanted.
    `seed`: of intervals.
    `progress`: told the share done and what is being done.
    """
    # these bring solvers along, which other traces need not wait for
    from filters.multiposition.calibration import calibrate
    from filters.multiposition.report import notes, report

    found = calibrate([read.run for read in fitted], None if held is None else held.run, seed, progress)
    return report(found, asked, seed), notes(found)
