"""A recording, made here, through the C core and the simulated STM32F103; and golden vectors on the C core."""

import tempfile
from pathlib import Path

import numpy as np

import plumb

time_s = np.arange(0.0, 6.0, 0.01)
angle_rad = np.radians(30.0) * np.sin(2.0 * np.pi * 0.2 * time_s)
gyr = np.zeros((len(time_s), 3))
gyr[:, 0] = np.gradient(angle_rad, 0.01)
acc = 9.80665 * np.stack([0.0 * time_s, np.sin(angle_rad), np.cos(angle_rad)], axis=1)
quat = np.stack([np.cos(angle_rad / 2), np.sin(angle_rad / 2), 0.0 * time_s, 0.0 * time_s], axis=1)

with tempfile.TemporaryDirectory() as folder:
    path = Path(folder) / "rocking.npz"
    np.savez(path, time_s=time_s, gyr=gyr, acc=acc, ref_quat=quat)
    recording = plumb.load(path)
    for board in ("native", "virtual"):
        result = recording.replay("quad", board, axis="x")
        print(f"{board}: {result.metrics['angle_rmse_deg']:.2f} deg rms, bit-exact: {result.bit_exact}")

checked = plumb.golden.check(boards=["native"], systems=["quad"])
print(f"{len(checked.vectors)} vectors, {checked.steps} steps, bit-exact: {checked.bit_exact}")

# Prints:
#     native: 0.10 deg rms, bit-exact: True
#     virtual: 0.10 deg rms, bit-exact: True
#     49 vectors, 110040 steps, bit-exact: True
