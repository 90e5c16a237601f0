"""Names that files and results have for effects, as plain words for whoever reads a screen or a page."""

from collections.abc import Iterable

from filters.effects import plain_names


def state(name: str) -> str:
    """A state in the filter: "gy thermal_lin k (rad/s/K)" is "gy: bias follows temperature"."""
    return plain_names.state(name)


def included(names: Iterable[str]) -> str:
    """Effects with their channels in brackets, "thermal_lin (gx gy)", as one sentence's part."""
    parts = ((name, *name.removesuffix(")").partition(" (")) for name in names)
    return "; ".join(
        plain_names.on_channels(code, channels.split()) if bracket else name for name, code, bracket, channels in parts
    )
