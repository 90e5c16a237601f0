"""Where programs of the system are found, those for its administrator among them."""

import os
import shutil

_ADMINISTRATORS = "/usr/local/sbin:/usr/sbin:/sbin"


def find(name: str) -> str | None:
    """Path of a program; None if this machine does not have it."""
    return shutil.which(name, path=f"{os.environ.get('PATH', os.defpath)}:{_ADMINISTRATORS}")
