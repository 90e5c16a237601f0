"""What to do after a replay, in the order in which to do it: sentences made of the result document alone."""

from pathlib import PurePath
from typing import TYPE_CHECKING

from imutui.verdict import sources

if TYPE_CHECKING:
    from imutui.jobs.documents import ResultDocument


def after_replay(d: "ResultDocument") -> list[str]:
    """What to do after a replay.

    `d`: the result; one in which a filter ran.
    """
    log = PurePath(d["log"]).name
    told = []
    if "damage" in d:
        told.append(
            f"The file is damaged. `imutui recover {log} -o WHOLE.mcap` makes a whole file of what can be read."
        )
    found = sources.of_document(d)
    if found.level == "bad":
        told.append(
            f"Do not use these biases as they are: readings and model contradict each other. `imutui trace {log}` looks"
            " for the cause."
        )
    elif found.passes:
        told.append(
            "Subtract the biases of the table below: corrected reading = reading − bias, in the unit's own axes."
        )
    else:
        told.append(
            "Do not use a bias that has not converged: record longer, with the unit warmed up. A bias that keeps moving"
            f" follows something; `imutui trace {log}` looks for what it is."
        )
    if d.get("unobservable"):
        told.append(
            f"To see {', '.join(_plain(name) for name in d['unobservable'])} as well, record on a table whose attitude"
            " is known (`--reference level`, or a table profile)."
        )
    told += [f"{sentence}: another motion tells them apart." for sentence in d.get("confounded", [])]
    if d["lost_packets"] or d["bad_checksums"]:
        told.append(
            f"{d['lost_packets']} packets were lost and {d['bad_checksums']} had bad checksums: look at cable, adapter"
            " and supply."
        )
    return told


def _plain(name: str) -> str:
    return name.replace("_bias", " bias").replace("_", " ")
