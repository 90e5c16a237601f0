"""Means of a log's samples, read with imutui: python read_with_imutui.py LOG.mcap."""

import sys
from pathlib import Path

import numpy as np

from imutui.logbook import reader

log = reader.read(Path(sys.argv[1]))
samples = log.samples.rows(log.samples.valid)
rate, force = samples.gyro, samples.accel
print(f"{log.info.kind}, serial number {log.info.serial_number}")
print(f"{len(rate)} samples, {log.seconds()[-1]:.3f} s")
print("angular rate, deg/s:  ", *(f"{value:.6f}" for value in np.rad2deg(rate).mean(axis=0)))
print("specific force, m/s²: ", *(f"{value:.6f}" for value in force.mean(axis=0)))
