"""Names of the instruments, and of a port that is none, as command lines and plans have them.

Loads nothing, so that help is there at once.
"""

IMU400CD = "imu400cd"
IMU381 = "imu381"

NAMES = (IMU400CD, IMU381)
"""Of every member of the registry, in its order."""

DEFAULT = IMU400CD
"""Of the one that is meant unless another is named."""

VIRTUAL_PORT = "virtual"
"""Port that starts a virtual instrument of the acquisition's own."""
