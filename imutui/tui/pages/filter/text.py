"""What the Filter page says: the state at length, and where a value lies between its limits. Pure functions."""

from imutui.estimates import FilterSnapshot
from imutui.report import effect_words, wrapping
from imutui.tui import formatting
from imutui.tui.connection.model import View
from imutui.verdict.rules import (
    ACCEL_TOLERANCE_MG,
    GYRO_TOLERANCE_DPS,
    LEVEL_MARKS,
    NOTICED,
    STEADY_K_PER_MIN,
    TOO_MUCH,
    Verdict,
    nis_meaning,
)

_RULES = f"""\
RULES
  GREEN  all observable biases converged, nothing unexplained, T steady
  AMBER  a bias not converged; 10 s means {NOTICED:g} to {TOO_MUCH:g} times what noise allows;
         an effect that shows beyond {GYRO_TOLERANCE_DPS:g} deg/s or {ACCEL_TOLERANCE_MG:g} mg;
         temperature beyond ±{STEADY_K_PER_MIN:g} K/min; NIS just outside its band; no data
  RED    an alarm; the filter stopped; 10 s means above {TOO_MUCH:g} times what
         noise allows; a bias outside its limit; NIS far outside its band
  A word stands for 2 s at least.
  Converged: for 10 s sd below {GYRO_TOLERANCE_DPS:g} deg/s or {ACCEL_TOLERANCE_MG:g} mg, the estimate within that
  of its 10 s mean, and the readings in agreement with it."""


def explanation(view: View) -> str:
    """Every rule with what it found, alarms, effects, NIS and means in full."""
    found = view.shown_verdict
    if found is None:
        return "No acquisition: 1 connects to one."
    estimates = view.estimates
    parts = [
        f"{found.badge}  {found.followed_by(found.todo_at_length)}",
        "\n".join(f"{LEVEL_MARKS[c.level]:<6}{c.name}: {c.said}" for c in found.checks),
    ]
    if estimates is not None:
        effects = _listed("LOADED EFFECTS, ± 3 sd", [effect_words.estimate(effect) for effect in estimates["effects"]])
        told = [f"{'now ' if one['shows'] else 'past'} {one['text']}" for one in estimates["causes"]]
        told += [f"gone {one['text']}" for one in estimates["causes_gone"]]
        parts += [_listed("EFFECTS THAT THE RESIDUAL SHOWS", told)]
        parts += [_alarms(found, estimates), effects, _more(estimates)]
    return "\n\n".join(part for part in [*parts, wrapping.joined(_RULES)] if part) + "\n"


def _listed(title: str, entries: list[str]) -> str:
    return "\n".join([title, *(f"  {entry}" for entry in entries)]) if entries else ""


def _alarms(found: Verdict, estimates: FilterSnapshot) -> str:
    """Alarms beside those that are said above already."""
    above = " ".join(check.said for check in found.checks)
    alarms = dict.fromkeys([*estimates["alarms"], *estimates["confounded"]])
    return _listed("ALARMS", [alarm for alarm in alarms if alarm not in above])


def _more(estimates: FilterSnapshot) -> str:
    nis = estimates["nis"]
    ratios = [f"{r['channel']} {formatting.number(r['ratio'], 0, 1)}" for r in estimates["remainder"]]
    out = [f"NIS mean {formatting.plain(nis['mean'], 3)} of {nis['dof']:g}, {nis_meaning(nis, whole=True)}"]
    if ratios:
        out.append(f"10 s means over what noise allows: {'  '.join(ratios)}")
    out.append(f"{formatting.plural(estimates['rejected'], 'update')} left out as outliers")
    return _listed("NUMBERS", out)


CELLS = 11


def gauge(value: float | None, limit: float | None, sd3: float | None = None) -> str:
    """Bar from zero in the middle to the value; ░ where three standard deviations reach; ▲ at the end beyond a limit.

    `limit`: of the data sheet, at both ends; None for a unit without one, whose bar stays empty.
    `sd3`: three standard deviations; None for not known.
    """
    middle = CELLS // 2
    cells = ["·"] * CELLS
    if value is not None and limit is not None:
        if sd3 is not None:
            low, high = _cell(value - sd3, limit), _cell(value + sd3, limit)
            cells[middle + low : middle + high + 1] = "░" * (high - low + 1)
        end = _cell(value, limit)
        first, last = min(end, 0), max(end, 0)
        cells[middle + first : middle + last + 1] = "█" * (last - first + 1)
        if abs(value) > limit:
            cells[middle + (middle if value > 0 else -middle)] = "▲"
    cells[middle] = "│"
    return f"▕{''.join(cells)}▏"


def _cell(value: float, limit: float) -> int:
    """Cell of a value, counted from the middle; the outermost for what is beyond."""
    middle = CELLS // 2
    reach = min(abs(value) / limit * middle, middle)
    cells = int(reach + 0.5)
    return cells if value > 0 else -cells
