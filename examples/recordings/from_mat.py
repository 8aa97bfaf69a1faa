"""Convert a recording of the BROAD data set for plumb: python from_mat.py IN.mat OUT.npz"""

import sys

import numpy as np
from scipy.io import loadmat

source = loadmat(sys.argv[1], squeeze_me=True)
np.savez_compressed(
    sys.argv[2],
    gyr=source["imu_gyr"].astype(np.float32),  # rad/s, (N, 3)
    acc=source["imu_acc"].astype(np.float32),  # m/s^2, (N, 3), about +9.81 on the axis that points up at rest
    ref_quat=source["opt_quat"].astype(np.float32),  # w x y z, (N, 4), sensor to an earth frame with z up; NaN: lost
    movement=source["movement"].astype(bool),  # (N,), the samples to be scored
    rate_hz=float(source["sampling_rate"]),
)
