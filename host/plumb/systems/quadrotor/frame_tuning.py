"""The tuning of a frame by its numbers: the rule of the bring-up page.

    acceleration  about each axis by a full command of that axis, in a hover, by the slope of the thrust curve there
    lead          LEAD_SHARE of the motors' lag, the mean of rising and falling: the derivative takes so much of it back
    decay of roll and pitch    RATE_PER_S times what the hummingbird's loop waits for, over what this one waits for: the
                               lag that the lead leaves, and DELAY_S
    decay of yaw               the same with the whole lag: yaw has no derivative
    integral of roll and pitch INTEGRAL_PER_S, and faster by as much as the decay is slower: a weak rotor or a load that
                               is off centre is held by the loop until the integral takes it
    gain of the level          as the decay of roll and pitch, at most the shipped one

No decay is faster than the hummingbird's, whose margins were measured; the proportional gain is the decay over the
acceleration.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from plumb.physics.airframe import HUMMINGBIRD_X, THRUST_LINEAR, THRUST_SQUARE, Airframe
from plumb.systems.quadrotor.settings import RateGains, Rates
from plumb.systems.quadrotor.tuning import QuadrotorTuning

RATE_PER_S, YAW_PER_S, INTEGRAL_PER_S = 28.0, 8.0, 1.5
"""Of the hummingbird's rate loops: how fast an error of a rate decays; how fast the integral takes its place."""
LEAD_SHARE, DELAY_S = 0.64, 0.005
"""DELAY_S: of sampling, step, speed controller, and the low-pass of the derivative."""
KP_MOST_PER_DPS, KD_MOST_PER_DPS2 = 1.0 / 180.0, 4.4e-5
"""The largest that the integers hold, of kd at 400 Hz: where a frame asks for more, its error decays more slowly."""
DEG = np.pi / 180.0


def gains(
    decay_per_s: float, accel_radps2: float, lead_s: float = 0.0, integral_per_s: float = INTEGRAL_PER_S
) -> RateGains:
    """Of one axis. accel_radps2: angular acceleration by a command of 1; lead_s, integral_per_s: derivative, integral
    by proportional gain."""
    kp = min(decay_per_s / accel_radps2 * DEG, KP_MOST_PER_DPS)
    kp = min(kp, KD_MOST_PER_DPS2 / lead_s) if lead_s > 0.0 else kp
    return RateGains(kp_per_dps=kp, ki_per_deg=kp * integral_per_s, kd_per_dps2=kp * lead_s)


def accelerations_radps2(frame: Airframe) -> tuple[float, float, float]:
    """About x, y, z, by a command of 1, in a hover."""
    per_rotor_n = frame.thrust_max_n / 4.0 * (2.0 * THRUST_SQUARE * frame.hover_command + THRUST_LINEAR)
    x, y, z = np.abs(frame.allocation()[1:]).sum(axis=1) * per_rotor_n / np.array(frame.inertia_kgm2)
    return float(x), float(y), float(z)


def lag_s(frame: Airframe) -> float:
    """Of its motors: the mean of rising and falling."""
    return (frame.lag_up_s + frame.lag_down_s) / 2.0


def decays_per_s(frame: Airframe) -> tuple[float, float]:
    """How fast errors of the rate decay: of roll and pitch, and of yaw."""
    left, known = 1.0 - LEAD_SHARE, lag_s(HUMMINGBIRD_X)
    tilt = (left * known + DELAY_S) / (left * lag_s(frame) + DELAY_S)
    yaw = (known + DELAY_S) / (lag_s(frame) + DELAY_S)
    return RATE_PER_S * min(tilt, 1.0), YAW_PER_S * min(yaw, 1.0)


def rates_of(frame: Airframe, accel_radps2: tuple[float, float, float]) -> Rates:
    """Gains of a frame on which a command of 1 makes these accelerations about x, y, z."""
    (x, y, z), (tilt_per_s, yaw_per_s) = accel_radps2, decays_per_s(frame)
    lead_s, integral_per_s = round(LEAD_SHARE * lag_s(frame), 6), INTEGRAL_PER_S * RATE_PER_S / tilt_per_s
    roll, pitch = (gains(tilt_per_s, accel, lead_s, integral_per_s) for accel in (x, y))
    return Rates(roll=roll, pitch=pitch, yaw=gains(yaw_per_s, z))


def tuned(shipped: QuadrotorTuning, frame: Airframe) -> QuadrotorTuning:
    """The shipped tuning with gains, drag and hover of a frame."""
    own = rates_of(frame, accelerations_radps2(frame))
    aid = replace(shipped.attitude.aid, drag_per_s=frame.drag_setting_per_s, hover=frame.hover_command)
    return replace(
        shipped,
        attitude=replace(shipped.attitude, aid=aid),
        rates=replace(shipped.rates, roll=own.roll, pitch=own.pitch, yaw=own.yaw),
        level=replace(shipped.level, gain_per_s=shipped.level.gain_per_s * decays_per_s(frame)[0] / RATE_PER_S),
    )
