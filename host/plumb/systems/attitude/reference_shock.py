"""How the float64 model of `attitude` notices that the bias of the gyro has stepped."""

from __future__ import annotations

import numpy as np

from plumb.spec.arrays import FloatArray
from plumb.systems.attitude.quantise import DEG, G_MPS2
from plumb.systems.attitude.reference_state import VARIANCE_LIMIT, Filter
from plumb.systems.attitude.tuning import AttitudeTuning

VELOCITY_UNIT_GS = 2.0
"""What 1 of the filter's velocities is."""
TRAVELS_G2S2 = 0.001
"""A smaller excess of a lasting velocity is no travel."""
RISE_G, RISE_LEAST_G = 0.6, 0.01
"""No body falls with the one for seconds; the other is the cosine of 8 deg."""
LEANS_G = 1.0 / 16.0
REST_G, TILTED_G = (0.975, 1.025), 0.9
"""Acceleration of a body at rest; beyond 26 deg off the vertical it shows that the vertical is wrong."""
HELD_SHARE = 1.0 / 32.0
"""Of the rate up to which a body rests: the least turn of a body that is held."""


def note_turn(x: Filter, tuning: AttitudeTuning, steps: int) -> None:
    """Notes how the block of so many steps has turned about horizontal axes, and whether the gyro alone has: with
    steady rates, and an acceleration that stays where it was in the body's axes. x.force_before: of the block before.
    """
    rest, block_s = tuning.rest, steps * tuning.period_s
    half, force = x.sums.turned.sum(axis=1), x.sums.force
    turn = float(np.abs(half).sum())
    x.turning_rad += block_s / tuning.motion.travel_s / 2.0 * (turn - x.turning_rad)
    up = x.force_before[2]
    left = force[:2] - x.force_before[:2] - 2.0 * up * np.array([half[1], -half[0]])
    stays = float(np.abs(left).sum()) <= 2.0 * rest.accel_g * steps
    turns = turn > HELD_SHARE * DEG * rest.turn_dps * block_s / 2.0
    held = x.flight.landed and not x.sums.moved and stays and turns
    x.held_blocks = min(x.held_blocks + 1, max(round(rest.seconds / block_s), 1)) if held else 0


def held_still(x: Filter, rest_blocks: int, steps: int) -> bool:
    """Whether the gyro alone has turned for as long as a rest takes, and the acceleration leans."""
    leans = float(np.abs(x.force_before[:2]).sum()) > LEANS_G * steps
    return leans and x.held_blocks == rest_blocks and x.travel_excess_g2s2 <= TRAVELS_G2S2


def lost_in_motion(x: Filter, tuning: AttitudeTuning, block_s: float) -> bool:
    """Whether the vertical acceleration is too small for seconds; or a body that turns about horizontal axes, and so
    does not drive, has a lasting velocity and an acceleration that leans."""
    explained = VELOCITY_UNIT_GS**2 * float(x.covariance[8, 8] + x.covariance[9, 9])
    least = (tuning.motion.travel_mps / G_MPS2) ** 2 / 2.0
    turns = x.turning_rad > DEG * tuning.rest.turn_dps * block_s / 2.0
    fast = float(x.travel_gs @ x.travel_gs) - explained > least
    return x.rise_g > RISE_G or (x.rise_g > RISE_LEAST_G and turns and fast)


def tilted_at_rest(mean_g: FloatArray) -> bool:
    """Whether the mean acceleration of a block, (3,) in earth axes, is 1 g and lies well off the vertical."""
    return REST_G[0] < float(np.linalg.norm(mean_g)) < REST_G[1] and float(mean_g[2]) < TILTED_G


def reopen(x: Filter, start_variance: FloatArray, growth: FloatArray) -> None:
    """Nothing is known of bias and tilt any more; both stay. start_variance: before the first sample, (10,); growth: of
    a block, (10,)."""
    variance = start_variance.copy()
    variance[:3] = 4.0 * np.minimum(variance[:3], VARIANCE_LIMIT / 4.0)
    variance[6:8] /= 8.0
    x.covariance, x.tilt_rad2 = np.diag(variance), 2.0 * float(start_variance[6])
    x.velocity_gs, x.square_g2s2, x.held_blocks = np.zeros(2), 0.0, 0
    x.travel_gs, x.travel_excess_g2s2, x.rise_g, x.corrected_rad = np.zeros(2), 0.0, 0.0, np.zeros(2)
    x.transition, x.growth = np.eye(10), np.array([*growth[:6], *np.zeros(4)])
