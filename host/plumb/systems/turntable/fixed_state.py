"""State of `turntable` in integers, and the values of one step."""

from __future__ import annotations

from dataclasses import dataclass, field

from plumb.kernels.fixed import fusion
from plumb.kernels.fixed.fusion import ANGULAR_BIAS, GYRO_BIAS, Covariance, Parameter
from plumb.kernels.fixed.kernels import Params
from plumb.kernels.fixed.prefilter import Sensor
from plumb.kernels.fixed.quaternion import ONE_Q30, Quaternion

AXES = range(3)
ANGULAR_STALE = 4
"""Steps; the gyro's history lasts four of its periods."""


def zeros() -> list[int]:
    return [0, 0, 0]


@dataclass(slots=True)
class TurntableState:
    gyro: Sensor
    angular: Sensor
    gyro_age_step_q24: int
    lag_step_q24: list[int]
    covariance_q64: Covariance
    scale: list[Parameter]
    lag: list[Parameter]
    attitude: Quaternion = (ONE_Q30, 0, 0, 0)
    attitude_angular: Quaternion = (ONE_Q30, 0, 0, 0)
    increment_turnps_q34: list[int] = field(default_factory=zeros)
    increment_lagged_turnps_q34: list[int] = field(default_factory=zeros)
    innovation_turnps_q28: list[int] = field(default_factory=zeros)
    rate_fused_turnps_q28: list[int] = field(default_factory=zeros)
    rate_corrected_turnps_q28: list[int] = field(default_factory=zeros)
    bias_gyro_turnps_q34: list[int] = field(default_factory=zeros)
    bias_angular_turnps_q42: list[int] = field(default_factory=zeros)
    scale_q30: list[int] = field(default_factory=zeros)
    clamped_steps: int = 0
    flags: int = 0
    step: int = 0


@dataclass(slots=True)
class TurntableStep:
    """Intermediate values of one step. age_q24: of the gyro's sample; lagged: the increment at its instant; expected:
    the rate there, less what the lag takes off; turn: rotations of `attitude` and of the angular accelerometer's."""

    rest: bool
    gyro: bool = False
    angular: bool = False
    gyro_lost: bool = False
    two_attitudes: bool = False
    shock: bool = False
    age_q24: int = 0
    lagged_q34: list[int] = field(default_factory=zeros)
    expected_q28: list[int] = field(default_factory=zeros)
    turn_q60: list[int] = field(default_factory=zeros)
    turn_angular_q60: list[int] = field(default_factory=zeros)


def control_init(p: Params) -> TurntableState:
    covariance_q64 = fusion.zeros()
    covariance_q64[GYRO_BIAS][GYRO_BIAS] = p["fusion.p_gyro_bias_q40"] << 24
    covariance_q64[ANGULAR_BIAS][ANGULAR_BIAS] = p["fusion.p_angular_bias_q52"] << 12
    return TurntableState(
        gyro=Sensor("gyro", p["fusion.gyro_period_step_q24"] >> 22),
        angular=Sensor("angular", ANGULAR_STALE),
        gyro_age_step_q24=p["fusion.gyro_age_step_q24"],
        lag_step_q24=[p["fusion.lag_step_q24"]] * 3,
        covariance_q64=covariance_q64,
        scale=[Parameter(p["fusion.v_scale_q40"] << 20) for _ in AXES],
        lag=[Parameter(p["fusion.v_lag_q30"] << 30) for _ in AXES],
    )


def is_spike(c: TurntableState, axis: int) -> bool:
    return (c.gyro.spikes >> axis) & 1 != 0
