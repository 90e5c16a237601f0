"""Means of a log's samples, read with imutui: python read_with_imutui.py LOG.mcap."""

import sys
from pathlib import Path

import numpy as np

from imutui.logbook import reader

log = reader.read(Path(sys.argv[1]))
rate, force = log.gyro[log.valid], log.accel[log.valid]
print(f"{log.info.kind}, serial number {log.info.serial_number}")
print(f"{len(rate)} samples, {(log.stamp_ns[-1] - log.stamp_ns[0]) / 1e9:.3f} s")
print("angular rate, deg/s:  ", *(f"{value:.6f}" for value in np.rad2deg(rate).mean(axis=0)))
print("specific force, m/s²: ", *(f"{value:.6f}" for value in force.mean(axis=0)))
