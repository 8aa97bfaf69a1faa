"""Motion of the turntable on a time grid: attitude, rate, and the rate behind a gyro's lag."""

from __future__ import annotations

import numpy as np

from plumb.spec.arrays import FloatArray
from plumb.systems.turntable.reference import multiply

REST_S, FADE_S = 10.0, 3.0


def at(time_s: FloatArray, grid_s: FloatArray, values: FloatArray) -> FloatArray:
    """Columns of a grid at any times, by linear interpolation."""
    return np.stack([np.interp(time_s, grid_s, column) for column in values.T], axis=1)


def motion(
    grid_s: FloatArray, slow: tuple[FloatArray, FloatArray], quick: tuple[FloatArray, FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """Attitude (n, 4) and body rate in deg/s (n, 3); slow, quick: frequencies in Hz and amplitudes in deg of roll,
    pitch and yaw (z-y-x), faded in after the rest."""
    t = np.maximum(grid_s - REST_S, 0.0)[:, None]
    on = 0.5 - 0.5 * np.cos(np.pi * np.minimum(t / FADE_S, 1.0))
    waves = [degrees * np.sin(2.0 * np.pi * hz * t) for hz, degrees in (slow, quick)]
    euler = np.radians(on * (waves[0] + waves[1]))
    roll, pitch, yaw = euler.T
    roll_rate, pitch_rate, yaw_rate = np.asarray(np.gradient(euler, grid_s[1] - grid_s[0], axis=0)).T
    rate = np.stack(
        [
            roll_rate - yaw_rate * np.sin(pitch),
            pitch_rate * np.cos(roll) + yaw_rate * np.sin(roll) * np.cos(pitch),
            yaw_rate * np.cos(roll) * np.cos(pitch) - pitch_rate * np.sin(roll),
        ],
        axis=1,
    )
    turns = [np.zeros((len(grid_s), 4)) for _ in range(3)]
    for axis, (turn, angle) in enumerate(zip(turns, (roll, pitch, yaw), strict=True)):
        turn[:, 0], turn[:, 1 + axis] = np.cos(angle / 2.0), np.sin(angle / 2.0)
    return multiply(multiply(turns[2], turns[1]), turns[0]), np.asarray(np.degrees(rate), np.float64)


def lagged(signal: FloatArray, tau_s: float, step_s: float) -> FloatArray:
    """The signal behind a first-order lag, (n, 3); exact for linear input between grid points, 0 before the first."""
    if tau_s == 0.0:
        return signal
    ratio = tau_s / step_s
    decay = float(np.exp(-1.0 / ratio))
    drive = np.zeros_like(signal)
    drive[1:] = (1.0 - ratio * (1.0 - decay)) * signal[1:] + (ratio * (1.0 - decay) - decay) * signal[:-1]
    block = 256
    i = np.arange(block)
    response = np.where(i[:, None] >= i, decay ** np.maximum(i[:, None] - i, 0), 0.0)
    fade = decay ** (i + 1.0)[:, None]
    result, carry = np.empty_like(signal), np.zeros(signal.shape[1])
    for start in range(0, len(signal), block):
        part = drive[start : start + block]
        n = len(part)
        result[start : start + n] = response[:n, :n] @ part + fade[:n] * carry
        carry = result[start + n - 1]
    return result
