"""Table profiles as files: found, read, turned into steps. Blocks, so it is called in threads.

What it calls loads numpy and scipy: only then, not when the screen starts.
"""

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from imutui.jobs.operator_steps import Offer, OperatorStep
    from imutui.session.snapshot import ProfileDescription


def found(folders: list[Path], experiment: tuple[str, str] | None = None) -> "list[Offer]":
    """The motion that a trace recommends (text, source) unless a file has it, ready-made profiles, those of folders."""
    from imutui.jobs import operator_steps

    offers = operator_steps.offers(folders)
    if experiment is None or any(offer.text == experiment[0] for offer in offers):
        return offers
    return [operator_steps.of_trace(*experiment), *offers]


def read(path: Path) -> "Offer":
    """The profile of a file; its `error` says why it cannot be used, if so."""
    from imutui.jobs import operator_steps

    return operator_steps.offer_of(path)


def by_hand(offer: "Offer") -> "Offer":
    """The same profile joined to the log by the operator's marks."""
    from imutui.jobs import operator_steps

    return operator_steps.by_hand(offer) or offer


def save(offer: "Offer", path: Path) -> None:
    """Write it to a new file; raises InputError or OSError with the reason if that cannot be."""
    from imutui.jobs import operator_steps

    operator_steps.save(offer, path)


def steps(offer: "Offer") -> "list[OperatorStep]":
    """What to do in each segment, for how long, and what it makes testable."""
    from imutui.jobs import operator_steps

    return operator_steps.steps(operator_steps.load(offer.file, offer.text))


def makes_testable(profile: "ProfileDescription") -> list[list[str]]:
    """What each segment makes testable."""
    from imutui.jobs import operator_steps

    return operator_steps.makes_observable(operator_steps.load(profile["name"], profile["text"]))
