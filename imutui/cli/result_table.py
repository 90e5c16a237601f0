"""Results as a table for people."""

from typing import TYPE_CHECKING, Literal

from rich.console import Console
from rich.table import Table
from rich.text import Text

if TYPE_CHECKING:
    from imutui.logbook.results import ResultDocument


def print_result(document: "ResultDocument") -> None:
    """Print a result document of a live run or a replay on stdout."""
    from imutui.plain_text import visible

    console = Console(highlight=False)
    console.print(Text(visible(_headline(document))))
    if "final" in document:
        console.print(_biases(document))
        for line in _lines(document):
            console.print(Text(visible(line)))


def _headline(d: "ResultDocument") -> str:
    from imutui.report import numbers
    from imutui.verdict import sources

    if "final" not in d:
        said = f"{d['log']}: {d['samples']} samples, no filter"
        return f"{said}\n{sources.reasons(d)}" if d["alarms"] else said
    rate = f"{d['rate_hz']:.2f} Hz" if d["rate_hz"] else "one sample"
    size = f"{d['samples']} samples, {d['duration_s']:.1f} s at {rate}"
    about = f"{size}, {numbers.readings(d['kind'])}, filter {d['filter']}, reference {d['reference']}"
    return f"{sources.headline(d)}\n{sources.reasons(d)}\n{about}"


def _biases(d: "ResultDocument") -> Table:
    table = Table("bias", "estimate", "± 3 sd", "unit", "converged", box=None, pad_edge=False)
    truth = d.get("truth")
    if truth:
        table.add_column("truth")
    for column in table.columns[1:3]:
        column.justify = "right"
    kinds: tuple[tuple[str, Literal["gyro_bias_dps", "accel_bias_mg"], str, int], ...]
    kinds = (("gyro", "gyro_bias_dps", "deg/s", 4), ("accel", "accel_bias_mg", "mg", 3))
    for kind, key, unit, digits in kinds:
        for i, axis in enumerate("xyz"):
            value, sd = d["final"][key][i], d["sd"][key][i]
            since = d["converged_s"][f"{kind}_bias"][i]
            if value is None or sd is None:
                row = [f"{axis} {kind}", "–", "–", unit, "not observable with this reference"]
            else:
                when = f"at {since:.0f} s" if since is not None else "not yet"
                row = [f"{axis} {kind}", f"{value:.{digits}f}", f"{3 * sd:.{digits}f}", unit, when]
            table.add_row(*row, *([f"{truth[key][i]:.{digits}f}"] if truth else []))
    return table


def _lines(d: "ResultDocument") -> list[str]:
    from imutui.report import numbers
    from imutui.verdict import sources

    nis = d["nis"]
    out = []
    if nis["mean"] is not None:
        meaning = (
            f"95 % band {nis['band95'][0]:.3f} to {nis['band95'][1]:.3f}"
            if nis["is_test"]
            else f"no test: {nis['why']}"
        )
        out.append(f"NIS {nis['mean']:.4f} of {nis['dof']:.4g} ({meaning})")
    arw, vrw = d["noise"]["gyro_arw_deg_sqrt_h"], d["noise"]["accel_vrw_mps_sqrt_h"]
    sure = numbers.noise_certainty(d["noise"].get("relative_sd"))
    if sure is None:
        out.append(f"noise of this log: {numbers.TOO_SHORT}")
    else:
        gyro_says, accel_says = sources.noise_stated(d)
        both = f"gyro {_triple(arw)} deg/√h ({gyro_says}), accel {_triple(vrw)} m/s/√h ({accel_says})"
        out.append(f"noise of this log: {both}, each {sure}")
    used = d["noise"]["used"]
    if used["source"] == "log":
        walk = f"gyro {_triple(used['gyro_walk_dps_sqrt_h'], 3)} deg/s/√h"
        walk += f", accel {_triple(used['accel_walk_mps2_sqrt_h'], 4)} m/s²/√h"
        white = f"gyro {_triple(used['gyro_arw_deg_sqrt_h'])} deg/√h"
        white += f", accel {_triple(used['accel_vrw_mps_sqrt_h'])} m/s/√h"
        out.append(f"noise used, by Allan deviation: {white}; drift of the biases: {walk}")
    if d["rejected"]:
        out.append(f"{d['rejected']} updates left out as outliers")
    if d["gaps"]:
        from imutui.jobs.quantities import plural

        longest = max(d["gaps"], key=lambda gap: gap["seconds"])
        out.append(f"{plural(len(d['gaps']), 'gap')}, longest {longest['seconds']:.3f} s at {longest['t']:.3f} s")
    if d["lost_packets"] or d["bad_checksums"]:
        out.append(f"{d['lost_packets']} packets lost, {d['bad_checksums']} bad checksums")
    if d.get("history_known") is False and _remembers(d):
        out.append(
            "effects of this filter remember temperature, and what came before this log is not known: they begin as if"
            " it had rested, and biases do not compare with those of another log"
        )
    above = sources.reasons(d)
    out += [f"CANNOT BE TOLD APART: {sentence}" for sentence in d["confounded"]]
    return out + [f"ALARM: {alarm}" for alarm in d["alarms"] if alarm not in above]


def _remembers(d: "ResultDocument") -> bool:
    """Whether an effect of the filter has a memory of temperature: names are channels, effect, parameter, unit."""
    return any(word in effect["name"].split() for effect in d["effects"] for word in ("hysteresis", "thermal_lag"))


def _triple(values: list[float | None], digits: int = 2) -> str:
    return " ".join("–" if v is None else f"{v:.{digits}f}" for v in values)
