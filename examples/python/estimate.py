"""Tilt of a rocking body from arrays of gyro and accelerometer, by the integers that the board runs."""

import numpy as np

import plumb

PERIOD_S = 0.005
time_s = np.arange(2000) * PERIOD_S
angle_rad = np.radians(20.0) * np.sin(2.0 * np.pi * 0.3 * time_s)  # about x
rng = np.random.default_rng(1)

gyr_radps = np.zeros((2000, 3))
gyr_radps[:, 0] = np.gradient(angle_rad, PERIOD_S) + np.radians(2.0)  # a bias of 2 deg/s
gyr_radps += np.radians(0.1) * rng.standard_normal((2000, 3))
acc_mps2 = 9.80665 * np.stack([0.0 * angle_rad, np.sin(angle_rad), np.cos(angle_rad)], axis=1)
acc_mps2 += 0.1 * rng.standard_normal((2000, 3))

estimator = plumb.Estimator("quad", period_s=PERIOD_S, gyr_range_dps=250, acc_range_g=2)
estimate = estimator.run(gyr_radps, acc_mps2)
error_deg = np.degrees(estimate.tilt_rad - angle_rad)[1000:]
print(f"tilt error {np.sqrt(np.mean(error_deg**2)):.2f} deg rms over the last 5 s")
print(f"bias {np.degrees(estimate.bias_radps[-1]):.2f} deg/s")

steps = [estimator.step(gyr, acc) for gyr, acc in zip(gyr_radps, acc_mps2, strict=True)]
same = [step.digest for step in steps] == estimate.digests.tolist()
print(f"sample by sample: {'the same bits' if same else 'other bits'}")

# Prints:
#     tilt error 0.04 deg rms over the last 5 s
#     bias 1.99 deg/s
#     sample by sample: the same bits
