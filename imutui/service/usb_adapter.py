"""The USB adapter that a serial port belongs to, as the kernel describes it in /sys."""

import os
from dataclasses import dataclass
from pathlib import Path

from filters.errors import InputError

SYS = Path("/sys")


@dataclass(frozen=True, slots=True)
class UsbAdapter:
    """An adapter, or one port of it."""

    # vendor, product: four hexadecimal digits each
    vendor: str
    product: str
    serial: str  # its serial number; "" for the many that have none
    interface: str  # which of its ports, two hexadecimal digits
    socket: str  # where it is plugged in, such as "1-1.2"


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
