"""Effects and drivers in plain words. Standard library only, so that texts can be made without an array library."""

from collections.abc import Callable, Iterable

_EFFECTS = {
    "thermal_lin": "bias follows temperature",
    "thermal_poly": "bias is a curve in temperature",
    "thermal_rate": "bias follows the rate of temperature",
    "thermal_lag": "bias lags behind temperature",
    "hysteresis": "bias remembers the way temperature came (play)",
    "warmup": "bias settles after power-on",
    "ramp": "bias runs away with time",
    "scale": "scale factor is off",
    "asymmetry": "scale factor differs between + and -",
    "nonlinearity_cubic": "cubic nonlinearity",
    "nonlinearity_quadratic": "quadratic nonlinearity",
    "thermal_scale": "scale factor follows temperature",
    "cross_axis": "senses the other axes",
    "mounting": "the unit sits turned on the table",
    "g_sensitivity": "bias follows specific force",
    "g_squared": "bias follows the square of specific force",
    "earth_rate": "Earth rate is not as assumed",
    "harmonic": "error turns with the table",
    "delay": "readings are late",
    "lever_arm": "the unit is away from the axes of rotation",
    "tilt": "the table's base is not level",
    "gravity": "gravity is not as assumed",
    "tone": "oscillates",
    "step": "bias steps",
    "telegraph": "bias jumps between two levels",
    "random_walk": "bias walks at random",
    "gauss_markov": "bias drifts",
    "bias": "bias is not zero",
    "noise_level": "noise changes its level",
    "bandwidth": "noise is band-limited",
    "noise_crosstalk": "noise is correlated",
    "spikes": "spikes",
    "stuck": "the reading is stuck",
    "saturation": "the reading is at its limit",
    "coarse": "readings are coarse",
    "dropout": "readings are missing",
    "jitter": "time stamps are off",
}
_DRIVERS = {
    "time": "time",
    "temperature": "temperature",
    "temperature_rate": "the rate of temperature",
    "temperature_threshold": "which side of a temperature it is on",
    "since_motion": "the time since the last motion",
    "rate_norm": "the size of the rate",
    "table_accel": "the table's angular acceleration",
    **{f"w{axis}": f"the rate about {axis}" for axis in "xyz"},
    **{f"f{axis}": f"the specific force along {axis}" for axis in "xyz"},
}
_OF_AXES = {
    "angle": "the {} angle",
    "direction": "the direction in which the {} axis last turned",
    "turns": "the turns of the {} axis",
    "settling": "how long ago the {} axis turned, and which way",
}

_OPERATORS = {
    "lag": "lag of {}",
    "play": "play in {}",
    "relay": "relay of {}",
    "hold": "{} held for a while",
    "kink": "{} above a knee",
    "dead_zone": "{} beyond a dead zone",
    "creep": "creep with {}",
    "power": "power of {}",
    "curve": "curve over {}",
    "rate": "rate of change of {}",
}

_PARAMETERS = {
    "k": "size",
    "k1": "linear term",
    "k2": "quadratic term",
    "k3": "cubic term",
    "k_lag": "part that lags behind",
    "k_play": "part that remembers (play)",
    "tau": "time constant",
    "width": "width of the play",
    "start": "where the play begins",
    "carried_over": "carries over to other runs",
    "weight": "weight of this form",
    "amplitude": "amplitude",
}

_SHORT = {
    "thermal_lin": "linear in temperature",
    "thermal_poly": "curve in temperature",
    "thermal_rate": "rate of temperature",
    "thermal_lag": "lag behind temperature",
    "hysteresis": "temperature hysteresis",
    "thermal_scale": "thermal scale factor",
    "scale": "scale factor",
    "asymmetry": "scale asymmetry",
    "nonlinearity_cubic": "cubic nonlinearity",
    "nonlinearity_quadratic": "quadratic nonlinearity",
    "tone": "oscillation",
    "telegraph": "two-level noise",
    "gauss_markov": "Gauss-Markov drift",
    "noise_crosstalk": "correlated noise",
    "bandwidth": "band-limited noise",
}


def driver(name: str) -> str:
    """A driver in words; a product as one of two.

    `name`: as in `driver:NAME`.
    """
    if "*" in name:
        a, b = name.split("*", 1)
        return f"{driver(a)} times {driver(b)}"
    kind, _, axis = name.partition("_")
    if kind in _OF_AXES and axis in ("outer", "middle", "inner"):
        return _OF_AXES[kind].format(axis)
    return _DRIVERS.get(name, name.replace("_", " "))


def effect(name: str) -> str:
    """An effect in words, free ones too; a name that is not known as it is, without underscores."""
    if name.startswith("cause:"):
        return f"error follows {_chain(name.removeprefix('cause:'), driver)}"
    if name.startswith("driver:"):
        return f"error is a function of {driver(name.removeprefix('driver:'))}"
    return _EFFECTS.get(name, name.replace("_", " "))


def _chain(name: str, words: Callable[[str], str]) -> str:
    """A chain of operators in words, and its input by `words`."""
    operator, _, inner = name.partition("(")
    return _OPERATORS[operator].format(_chain(inner[:-1], words)) if inner and operator in _OPERATORS else words(name)


def short(name: str) -> str:
    """An effect in three words, for a table: most codes are the field's terms as they are."""
    if name.startswith("driver:"):
        return f"curve over {name.removeprefix('driver:').replace('*', ' × ').replace('_', ' ')}"
    if name.startswith("cause:"):
        return _chain(name.removeprefix("cause:"), lambda of: of.replace("_", " "))
    return _SHORT.get(name, name.replace("_", " "))


def parameter(name: str) -> str:
    """A parameter in words; one that is not known as it is, without underscores."""
    return _PARAMETERS.get(name, name.replace("_", " "))


def on_channels(name: str, channels: Iterable[str]) -> str:
    """An effect with its channels: "gx gy: bias follows temperature"."""
    return f"{' '.join(channels)}: {effect(name)}"


def state(name: str) -> str:
    """A state of an effect in the filter: "gy thermal_lin k (rad/s/K)" is "gy: bias follows temperature".

    The parameter is said where it is not the effect's only one, which is called k.
    """
    channels, _, rest = name.partition(" (")[0].partition(" ")
    code, _, own = rest.partition(" ")
    said = on_channels(code, channels.split("/"))
    return said if own in ("", "k") else f"{said}, {parameter(own)}"


def named(label: str, code: str) -> str:
    """Words with the code name in brackets."""
    return f"{label} ({code})"
