"""The file of noise that users of Kalibr know (`imu.yaml`), and why some of its values are left out."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from filters.effects import plain_names
from imutui.jobs.correction_terms import Term
from imutui.jobs.residual_noise import NoiseLevel

TOPIC = "/imu/data_raw"
_KINDS = (
    ("accelerometer", ("ax", "ay", "az"), "m/s^2", "m/s^3"),
    ("gyroscope", ("gx", "gy", "gz"), "rad/s", "rad/s^2"),
)


@dataclass(frozen=True, slots=True)
class KalibrFile:
    """Text of a file, and what it lacks."""

    text: str  # YAML
    lacks: tuple[str, ...]  # sentences on values that the log cannot give


def imu_yaml(
    levels: Mapping[str, NoiseLevel],
    rate_hz: float | None,
    seconds: float | None,
    heading: str,
    terms: Iterable[Term] = (),
) -> KalibrFile:
    """Noise of a unit as Kalibr takes it: the noisiest axis of each kind.

    `levels`: by channel; empty where nothing was measured.
    `rate_hz`, `seconds`: of the log.
    `heading`: what it is of.
    `terms`: effects that the readings have in them: a walk cannot be told from what moves a channel in another way.
    """
    lines, lacks, terms = [f"# {heading}"], [], tuple(terms)
    for kind, channels, white_unit, walk_unit in _KINDS:
        known = {name: levels[name] for name in channels if name in levels}
        if not known:
            lacks.append(f"{kind}_noise_density and {kind}_random_walk: this log does not tell the noise.")
            continue
        noisiest = max(known, key=lambda name: known[name].white)
        level = known[noisiest]
        lines.append(
            f"{kind}_noise_density: {level.white:.3e}  # {white_unit}/sqrt(Hz), {noisiest}, +- {level.white_sd:.1e}"
        )
        walking = max(known, key=lambda name: known[name].walk)
        if (moved := _moved(terms, channels)) and known[walking].walk > 0.0:
            lacks.append(
                f"{kind}_random_walk: the readings have errors in them that look like a walk ({moved}). A report on the"
                " log that `imutui apply` makes has the walk of what is left."
            )
        elif known[walking].walk > 0.0 and any(level.follows_temperature for level in known.values()):
            lacks.append(
                f"{kind}_random_walk: the readings follow the temperature, and a walk is not told from that."
                " `imutui trace` finds what temperature does."
            )
        elif known[walking].walk > 0.0:
            lines.append(f"{kind}_random_walk: {known[walking].walk:.3e}  # {walk_unit}/sqrt(Hz), {walking}")
        else:
            length = "" if seconds is None else f" of {seconds:.0f} s"
            lacks.append(f"{kind}_random_walk: no random walk shows in this log{length}; a longer one is needed.")
    lines.append(f"rostopic: {TOPIC}")
    if rate_hz is None:
        lacks.append("update_rate: this log does not tell it.")
    else:
        lines.append(f"update_rate: {rate_hz:.2f}  # Hz")
    return KalibrFile("\n".join(lines), tuple(lacks))


def _moved(terms: Iterable[Term], channels: Iterable[str]) -> str:
    """What moves channels of a kind beside a constant bias and a walk, in words; empty for nothing."""
    own = set(channels)
    named = (
        plain_names.on_channels(term.effect, term.channels)
        for term in terms
        if own.intersection(term.channels) and term.effect not in ("bias", "random_walk")
    )
    return "; ".join(dict.fromkeys(named))
