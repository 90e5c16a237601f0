"""Means of a log's samples, read with rosbags and without imutui: python read_with_rosbags.py LOG.mcap."""

import sys
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

path = Path(sys.argv[1])
with path.open("rb") as file:
    # what a log says of itself; the last record counts, for a note may have been changed
    session = [record.metadata for record in make_reader(file).iter_metadata() if record.name == "imutui.session"][-1]

stamps, rates, forces = [], [], []
with AnyReader([path]) as bag:
    topic = [connection for connection in bag.connections if connection.topic == "/imu/data_raw"]
    for connection, _, data in bag.messages(topic):
        m = bag.deserialize(data, connection.msgtype)
        stamps.append(m.header.stamp.sec * 1_000_000_000 + m.header.stamp.nanosec)
        if m.angular_velocity_covariance[0] != -1.0:  # else there is no valid reading at this stamp
            rates.append([m.angular_velocity.x, m.angular_velocity.y, m.angular_velocity.z])
            forces.append([m.linear_acceleration.x, m.linear_acceleration.y, m.linear_acceleration.z])

print(f"{session['kind']}, serial number {session['serial_number']}")
print(f"{len(rates)} samples, {(stamps[-1] - stamps[0]) / 1e9:.3f} s")
print("angular rate, deg/s:  ", *(f"{value:.6f}" for value in np.rad2deg(rates).mean(axis=0)))
print("specific force, m/s²: ", *(f"{value:.6f}" for value in np.array(forces).mean(axis=0)))
