"""How the simulated body moves: its orientation and its acceleration on a fine grid.

The orientation is a rotation vector that begins and ends at 0 behind a common turn: a run begins and ends at rest in
one attitude, so that a served board can play it again and again. Rates are those of the finite turns between two grid
points, not derivatives of angles (physics/rotation.py).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from plumb.physics.sensors import band_noise
from plumb.spec.arrays import FloatArray

GRID_S = 0.001
G_MPS2 = 9.80665
REST_S, FADE_S = 5.0, 2.0
"""Rest at both ends, and the time in which motion sets in; shorter in runs that have no room for it."""
TURN_DEG, TURN_HZ, SHIFT_M, SHIFT_HZ = 40.0, (0.05, 0.8), 0.05, (0.2, 2.0)
"""Rms of a component of the rotation vector and of the position in the hand, and the bands of their frequencies."""
FAST_TURN_DEG, FAST_TURN_HZ, FAST_SHIFT_M, FAST_SHIFT_HZ = 45.0, (0.3, 2.0), 0.1, (0.3, 2.0)
RADIUS_M, SPIN_HZ, SPIN_UP_S, SPIN_TILT_RAD = 0.4, 1.0, 4.0, np.radians(30.0)
"""`centrifuge`: 1.6 g, at 2.5 m/s."""
FALL_EVERY_S, FALL_S, PUSH_S = 8.0, 0.5, 0.25
"""`fall`: from one to the next, weightless, and felt at 2 g before and after it."""

Motion = tuple[FloatArray, FloatArray]
"""Rotation vector in rad, and acceleration of the body in g along the earth's axes, (3, points) each."""


def window(time_s: FloatArray) -> FloatArray:
    """0 at rest at both ends of the run, 1 between, raised cosines."""
    end_s = float(time_s[-1])
    rest_s, fade_s = min(REST_S, end_s / 6.0), min(FADE_S, end_s / 6.0)
    into = np.minimum(time_s, end_s - time_s) - rest_s
    return np.asarray(0.5 - 0.5 * np.cos(np.pi * np.clip(into / fade_s, 0.0, 1.0)))


def _acceleration_g(position_m: FloatArray) -> FloatArray:
    return np.gradient(np.gradient(position_m, GRID_S, axis=1), GRID_S, axis=1) / G_MPS2


def _noise(white: FloatArray, rms: float, band_hz: tuple[float, float]) -> FloatArray:
    return rms * np.stack([band_noise(one, *band_hz, GRID_S) for one in white])


def still(time_s: FloatArray, _white: FloatArray) -> Motion:
    """At rest."""
    return np.zeros((3, len(time_s))), np.zeros((3, len(time_s)))


def hand(time_s: FloatArray, white: FloatArray) -> Motion:
    """Turned and moved in the hand."""
    shown = window(time_s)
    turn = shown * _noise(white[:3], np.radians(TURN_DEG), TURN_HZ)
    return turn, _acceleration_g(shown * _noise(white[3:], SHIFT_M, SHIFT_HZ))


def fast(time_s: FloatArray, white: FloatArray) -> Motion:
    """Shaken and turned as fast as an arm does it."""
    shown = window(time_s)
    turn = shown * _noise(white[:3], np.radians(FAST_TURN_DEG), FAST_TURN_HZ)
    return turn, _acceleration_g(shown * _noise(white[3:], FAST_SHIFT_M, FAST_SHIFT_HZ))


def centrifuge(time_s: FloatArray, _white: FloatArray) -> Motion:
    """On an arm that turns, always the same side outwards."""
    angle = 2.0 * np.pi * SPIN_HZ * np.cumsum(window(time_s)) * GRID_S
    position = RADIUS_M * np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)])
    turn = np.zeros((3, len(time_s)))
    turn[2] = angle
    return turn, _acceleration_g(position)


def fall(time_s: FloatArray, white: FloatArray) -> Motion:
    """In the hand, thrown up and caught again and again."""
    turn, accel = hand(time_s, white)
    into = np.mod(time_s - REST_S - FADE_S, FALL_EVERY_S)
    inside = (time_s >= REST_S + FADE_S) & (time_s < time_s[-1] - REST_S - FADE_S)
    length_s = 2.0 * PUSH_S + FALL_S
    thrown = np.where((into >= PUSH_S) & (into < PUSH_S + FALL_S), -1.0, 1.0)
    flying = inside & (into < length_s)
    accel[:2, flying] = 0.0
    accel[2, flying] = thrown[flying]
    return turn, accel


MOTIONS: dict[str, Callable[[FloatArray, FloatArray], Motion]] = {
    "still": still,
    "hand": hand,
    "fast": fast,
    "centrifuge": centrifuge,
    "fall": fall,
}
