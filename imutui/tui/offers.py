"""What the connect page offers and says. Pure functions."""

from dataclasses import dataclass

from textual.content import Content

from imutui.session.plan import MAX_RATE_HZ, MIN_RATE_HZ, VIRTUAL_PORT
from imutui.tui import text
from imutui.tui.link import Snapshot

_NO_PORT = (
    "{found}. Plug an adapter in and it appears.\n"
    "Or press Enter to try the virtual instrument, which needs nothing else."
)
WAITING = """\
Waiting for {target}: {seconds:.0f} s of at most 30 s.

The acquisition process starts, opens the port, asks the instrument who it
is (ping, version, serial number), sets the mode, and waits for data.

Esc cancels."""


@dataclass(frozen=True, slots=True)
class Choice:
    """One line of the list: a running acquisition ("attach") or a port ("port")."""

    kind: str
    value: str
    label: str


def parse_rate(entered: str) -> float:
    """Output rate in Hz; ValueError with what is wrong. A decimal comma is fine."""
    try:
        rate = float(entered.strip().replace(",", "."))
    except ValueError:
        raise ValueError(f"not a number; {MIN_RATE_HZ:g} to {MAX_RATE_HZ:g} Hz") from None
    if not MIN_RATE_HZ <= rate <= MAX_RATE_HZ:
        raise ValueError(f"outside {MIN_RATE_HZ:g} to {MAX_RATE_HZ:g} Hz")
    return rate


def choices(running: list[str], ports: list[tuple[str, str]]) -> list[Choice]:
    """What the list offers: running acquisitions, real ports, and always the virtual instrument."""
    found = [Choice("attach", name, f'running acquisition "{name}": look at it again') for name in running]
    found += [Choice("port", port, f"{text.port_name(port, 44)}  {about}".rstrip()) for port, about in ports]
    return [*found, Choice("port", VIRTUAL_PORT, "virtual instrument  simulated IMU400CD on this machine")]


def likely(found: list[Choice]) -> Choice:
    """What Enter should take: a running acquisition, else an adapter, else the virtual instrument.

    Built-in ports (ttyS0) come last: most machines list them with nothing behind.
    """
    return next((c for c in found if c.kind == "attach" or "ttyS" not in c.value), found[-1])


def lead(found: list[Choice]) -> Content:
    """What to do, and if there is nothing to connect to, what then."""
    if likely(found).value != VIRTUAL_PORT:
        return Content.styled("Choose a port; Enter connects.", "bold")
    built_in = "No serial adapter, only built-in ports" if len(found) > 1 else "This machine has no serial port"
    return Content(_NO_PORT.format(found=built_in))


def connected(now: Snapshot) -> str:
    """What is connected, and what to do to change that."""
    return (
        f"Connected to {now['port']}\n{now['instrument']} #{now['serial_number']}, firmware {now['firmware']}\n"
        f'acquisition "{now["name"]}", process {now["pid"]}, {now["rate_hz"]:g} Hz, {now["sampling"]}\n\n'
        "To connect to something else, stop it first."
    )
