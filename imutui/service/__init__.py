"""What lets an acquisition run by itself: a unit of the user's systemd, and a udev rule for its serial adapter.

`user_unit` the unit, its settings, where they lie and whether systemd understands them · `udev_rule` the rule, for all
common adapters or for the one that a port belongs to. The templates of both lie here. Nothing here starts, stops or
installs a service.
"""

import os
import shutil

_ADMINISTRATORS = "/usr/local/sbin:/usr/sbin:/sbin"


def program(name: str) -> str | None:
    """Path of a program of the system, one for its administrator too; None if this machine does not have it."""
    return shutil.which(name, path=f"{os.environ.get('PATH', os.defpath)}:{_ADMINISTRATORS}")
