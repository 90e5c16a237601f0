"""Names that files and results have for effects, as plain words for whoever reads a screen or a page."""

from collections.abc import Iterable

from filters.effects import plain_names


def state(name: str) -> str:
    """A state in the filter: "gy thermal_lin k (rad/s/K)" is "gy: bias follows temperature"."""
    return plain_names.state(name)


def on_channels(effect: str, channels: Iterable[str]) -> str:
    """An effect with its channels before it; the name alone where there are none."""
    names = list(channels)
    return plain_names.on_channels(effect, names) if names else effect


def included(names: Iterable[str]) -> str:
    """Effects with their channels in brackets, "thermal_lin (gx gy)", as one sentence's part."""
    return "; ".join(_included(name) for name in names)


def _included(name: str) -> str:
    code, bracket, channels = name.removesuffix(")").partition(" (")
    return plain_names.on_channels(code, channels.split()) if bracket else name


def loaded(names: Iterable[str]) -> str:
    """Effects as a snapshot lists them, "gx/gy thermal_lin", as one sentence's part."""
    return "; ".join(plain_names.state(name) for name in names)
