"""The udev rule for serial adapters: a lasting name, a group, short latency, and others kept away.

The adapter that a serial port belongs to is what the kernel says of it in /sys.
"""

import grp
import os
import re
import subprocess
import tempfile
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

from filters.errors import InputError
from imutui import service

FILE = "99-imutui.rules"
FOLDER = Path("/etc/udev/rules.d")
SYS = Path("/sys")
COMMON = {"0403": "6001|6010|6011|6014|6015", "067b": "2303|23?3", "10c4": "ea60|ea70|ea71", "1a86": "5523|7523|55d?"}
"""Vendor and products of the usual RS-232 adapters: FTDI, Prolific, Silicon Labs, WCH."""

_GROUPS = ("dialout", "uucp")
_VERIFY_S = 20.0
_NO_SUCH_VERB = "unknown command verb"


@dataclass(frozen=True, slots=True)
class UsbAdapter:
    """An adapter, or one port of it."""

    # vendor, product: four hexadecimal digits each
    vendor: str
    product: str
    serial: str  # its serial number; "" for the many that have none
    interface: str  # which of its ports, two hexadecimal digits
    socket: str  # where it is plugged in, such as "1-1.2"


def text(adapter: UsbAdapter | None = None, name: str = "") -> str:
    """The rule.

    `adapter`: whose it is; None for all common ones, which keep the names that /dev/serial/by-id gives them.
    `name`: its port is called /dev/imutui-NAME.
    Raises InputError if the adapter's serial number or the name has letters that a rule cannot hold.
    """
    template = resources.files(__package__).joinpath(FILE).read_text()
    if adapter is None:
        device = ', GOTO="imutui_adapter_found"\n'.join(_common("ATTR"))
        port = ', GOTO="imutui_port_found"\n'.join(_common("ATTRS"))
        symlink = (
            "# its lasting name is that of /dev/serial/by-id; `imutui service --udev --port P --name N` gives it one"
        )
    else:
        device = _match(adapter, "ATTR", "KERNEL")
        port = f'ENV{{ID_USB_INTERFACE_NUM}}=="{_safe(adapter.interface)}", {_match(adapter, "ATTRS", "KERNELS")}'
        symlink = f'SYMLINK+="imutui-{_safe(name)}"'
    parts = {"DEVICE": device, "PORT": port, "GROUP": group(), "SYMLINK": symlink}
    for key, value in parts.items():
        template = template.replace(f"@{key}@", value)
    return template


def group() -> str:
    """Group that serial ports belong to on this machine."""
    known = {entry.gr_name for entry in grp.getgrall()}
    return next((name for name in _GROUPS if name in known), _GROUPS[0])


def file_name(name: str) -> str:
    """File of an acquisition's rule: one each, so that several units have theirs."""
    return f"{Path(FILE).stem}-{name}.rules"


def verified_by_udevadm(rule: str) -> str | None:
    """What `udevadm verify` says of a rule: "" if nothing, None if this machine's udev cannot verify (before 254)."""
    program = service.program("udevadm")
    if program is None:
        return None
    with tempfile.TemporaryDirectory(prefix="imutui-") as folder:
        path = Path(folder) / FILE
        path.write_text(rule)
        line = [program, "verify", "--resolve-names=never", "--no-style", str(path)]
        done = subprocess.run(line, capture_output=True, text=True, timeout=_VERIFY_S, check=False)
    said = (done.stdout + done.stderr).strip()
    if done.returncode == 0:
        return ""
    return None if _NO_SUCH_VERB in said.lower() else said


def _common(key: str) -> list[str]:
    return [f'{key}{{idVendor}}=="{vendor}", {key}{{idProduct}}=="{product}"' for vendor, product in COMMON.items()]


def _match(adapter: UsbAdapter, key: str, kernel: str) -> str:
    """Keys that one adapter has; without a serial number it is known by the socket that it is plugged into."""
    kind = f'{key}{{idVendor}}=="{_safe(adapter.vendor)}", {key}{{idProduct}}=="{_safe(adapter.product)}"'
    if adapter.serial:
        return f'{kind}, {key}{{serial}}=="{_safe(adapter.serial)}"'
    return f'{kind}, {kernel}=="{_safe(adapter.socket)}"'


def _safe(value: str) -> str:
    """A value between a rule's quotes; what would be a pattern or end them is refused."""
    if not re.fullmatch(r"[A-Za-z0-9 ._:@+-]+", value):
        raise InputError(f'"{value}" cannot stand in a udev rule: letters, digits and . _ : @ + - only')
    return value


# -------------------------------------------------------------------------------------------------------- usb adapter
# The USB adapter that a serial port belongs to, as the kernel describes it in /sys.


def of_port(port: str, sys: Path = SYS) -> UsbAdapter:
    """Adapter of a serial port.

    `port`: path of the device, or of a link to it.
    `sys`: where the kernel describes devices.
    Raises InputError if there is no such port, or it is on no USB adapter.
    """
    name = Path(os.path.realpath(port)).name
    device = sys / "class" / "tty" / name / "device"
    if not device.exists():
        raise InputError(f"{port} is no serial port of this machine. `imutui devices` lists them.")
    parents = [device.resolve(), *device.resolve().parents]
    usb = next((folder for folder in parents if (folder / "idVendor").is_file()), None)
    if usb is None:
        raise InputError(
            f"{port} is on no USB adapter: its name does not change and it needs no rule, only membership of its group."
        )
    interface = next((found for folder in parents if (found := _text(folder / "bInterfaceNumber"))), "00")
    return UsbAdapter(
        _text(usb / "idVendor"), _text(usb / "idProduct"), _text(usb / "serial"), interface, socket=usb.name
    )


def _text(path: Path) -> str:
    try:
        return path.read_text(errors="replace").strip()
    except OSError:  # an attribute that this adapter does not have
        return ""
