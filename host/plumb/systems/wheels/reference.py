"""`wheels` in float64: from counts, speed and turn rate to the duties of two motors.

Filter, speed loop and balance loop are those of the float64 model of balancer, which runs a step at a time: whether
somebody rides decides whether its controllers are at rest.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from plumb.kernels.reference import kernels
from plumb.kernels.reference.kernels import PidState
from plumb.spec import declarations
from plumb.spec.arrays import FloatArray
from plumb.systems.balancer import reference as balancer
from plumb.systems.wheels.tuning import Turning, WheelsTuning

NAMES = (
    "tilt_deg", "rate_corrected_dps", "velocity_mps", "lean_deg", "duty", "asked_mps", "asked_dps", "turn_rate_dps",
    "turn_bias_dps", "turn_wheels_dps", "duty_left", "duty_right",
)  # fmt: skip
FULL = 2.0**15
STOPPED, RIDDEN, STOPPING = range(3)
BIAS_MOST_DPS = 180.0
CLOSED_TAKES = 4
"""Open steps that a closed step of the rider's switch outweighs."""
KEPT_IN_SLIP = 31.0 / 32.0
"""Share of the integral that a step with a slipping wheel leaves."""


@dataclass
class Rider:
    """Whether somebody rides, and the receiver; times in steps."""

    phase: int = STOPPED
    phase_steps: int = 0
    absent: int = 0
    number: int = 0
    age: int = 0

    def hears(self, tuning: WheelsTuning, receiver: int) -> bool:
        """Whether the receiver is heard, or none is in use."""
        number = receiver & 255
        self.age = self.age + 1 if number and number == self.number else 0
        self.number = number
        late = self.age >= round(tuning.riding.lost_s / tuning.period_s)
        return not number or not (receiver & 256 or late)

    def step(self, tuning: WheelsTuning, present: bool, tilt_deg: float, on: bool) -> int:
        """The phase of this step."""
        riding, before = tuning.riding, self.phase
        full = round(riding.absent_s / tuning.period_s)
        self.absent = max(self.absent - CLOSED_TAKES, 0) if present else min(self.absent + 1, full)
        rides = present and self.absent == 0
        self.phase_steps += 1
        if not on:
            self.phase = STOPPED
        elif before == STOPPED:
            if rides and abs(tilt_deg) <= riding.up_deg:
                self.phase = RIDDEN
        elif before == RIDDEN:
            if self.absent >= full:
                self.phase = STOPPING
        elif rides:
            self.phase = RIDDEN
        elif self.phase_steps > round(riding.stopping_s / tuning.period_s):
            self.phase = STOPPED
        if self.phase != before:
            self.phase_steps = 0
        return self.phase


@dataclass
class TurnLoop:
    """Bias of the gyro, slip of a wheel, loop of the turn rate. slip: steps for which a wheel still slips; counts: of
    both wheels in the step before; excess: what balance left of the demand in the step before."""

    bias_dps: float = 0.0
    slip: int = 0
    counts: float = 0.0
    before_dps: float = 0.0
    integral: float = 0.0
    excess: float = 0.0

    def measure(self, turning: Turning, period_s: float, gyro_dps: float, counts: float) -> tuple[float, float]:
        """Turn rate that the wheels show, and the rate less bias, deg/s."""
        per_count = math.degrees(turning.count_m / turning.track_m) / period_s
        most = int(turning.wheels_max_dps / abs(per_count) + 1e-9)
        rolled_dps = min(max(counts, -most), most) * per_count
        apart = gyro_dps - rolled_dps - self.bias_dps
        self.slip = round(turning.slip_s / period_s) if abs(apart) > turning.slip_dps else max(self.slip - 1, 0)
        if not self.slip:
            counted = min(max(apart, -turning.doubt_dps), turning.doubt_dps)
            followed = self.bias_dps - math.expm1(-period_s / turning.bias_tau_s) * counted
            self.bias_dps = min(max(followed, -BIAS_MOST_DPS), BIAS_MOST_DPS)
        return rolled_dps, gyro_dps - self.bias_dps

    def both(self, left: float, right: float) -> float:
        """Counts of both wheels in this step; while one slips, twice those of the wheel that went on as before."""
        steady = min(left, right, key=lambda counts: abs(2.0 * counts - self.counts))
        self.counts = 2.0 * steady if self.slip else left + right
        return self.counts

    def step(
        self, turning: Turning, period_s: float, asked_dps: float, rate_dps: float, room: float, *, drives: bool
    ) -> float:
        """The duty for turning, of which balance leaves `room`."""
        error_dps, change_dps = asked_dps - rate_dps, rate_dps - self.before_dps
        self.before_dps = rate_dps
        if not drives:
            self.integral = self.excess = 0.0
            return 0.0
        if self.slip:
            self.integral *= KEPT_IN_SLIP
        elif self.excess * error_dps <= 0.0:
            grown = self.integral + turning.ki_per_deg * period_s * error_dps
            self.integral = min(max(grown, -turning.integral_max), turning.integral_max)
        direct = turning.kp_per_dps * error_dps + turning.ff_per_dps * asked_dps
        wanted = direct - turning.kd_per_dps2 * change_dps / period_s + self.integral
        turn = 0.0 if self.slip else min(max(wanted, -room), room)
        self.excess = wanted - turn
        return turn


def wrapped(counts: FloatArray) -> FloatArray:
    """Differences of 16-bit counts from step to step, 0 in the first."""
    return np.asarray((np.diff(counts, axis=0, prepend=counts[:1]) + 32768.0) % 65536.0 - 32768.0)


def one_run(tuning: WheelsTuning, raw: FloatArray, setpoint: FloatArray) -> FloatArray:
    """The columns NAMES of one run, (steps, names)."""
    own = replace(tuning.balance, period_us=tuning.period_us, exact_period_s=tuning.exact_period_s)
    axis, turning, period_s = own.calibration, tuning.turning, tuning.period_s
    rate_dps = kernels.calibrate(raw[:, 0], axis.gyro)
    accel_x_g = kernels.calibrate(raw[:, 1], axis.accel)
    accel_z_g = kernels.calibrate(raw[:, 2], axis.accel_up)
    up_dps = kernels.calibrate(raw[:, 3], axis.gyro)
    left, right = wrapped(raw[:, 4]), wrapped(raw[:, 5])
    state, rider, loop = balancer.ControlState(kernels.kalman_init(own.start)), Rider(), TurnLoop()
    found, tilt_deg = np.zeros((len(raw), len(NAMES))), 0.0
    wheel, hall = balancer.WheelState(), 0.0
    for step, (roll, pitch, yaw, switches, receiver) in enumerate(raw[:, 9:14].astype(int).tolist()):
        heard = rider.hears(tuning, receiver)
        on = not rider.number or bool(switches & 1)
        phase = rider.step(tuning, bool(raw[step, 6] > 0), tilt_deg, on)
        obeys = phase == RIDDEN and heard
        speed = float(pitch if rider.number else setpoint[step])
        asked_mps = obeys * float(np.clip(speed / FULL, -1.0, 1.0)) * own.speed.speed_max_mps
        asked_dps = obeys * float(np.clip((yaw - roll) / FULL, -1.0, 1.0)) * turning.rate_max_dps
        if phase == STOPPED:
            state.speed, state.pid = PidState(), PidState()
        rolled_dps, turn_dps = loop.measure(turning, period_s, float(up_dps[step]), float(right[step] - left[step]))
        hall = (hall + loop.both(float(left[step]), float(right[step]))) % 65536.0
        _, velocity_mps, wheel_g = balancer.wheel_step(wheel, own.wheel, period_s, hall)
        gravity_g, up_g = float(accel_x_g[step]) + wheel_g, float(accel_z_g[step])
        z_deg, r_deg2 = kernels.tilt(gravity_g, up_g, own.tilt), kernels.trust(gravity_g, up_g, own.trust)
        now = balancer.control_step(
            state, own, float(rate_dps[step]), float(z_deg), float(r_deg2), velocity_mps, wheel_g, asked_mps
        )
        tilt_deg, duty = float(now["tilt_deg"]), float(now["duty"])
        drives = phase != STOPPED and not state.fallen
        room = min(own.drive.duty_max - abs(duty), turning.duty_max)
        turn = loop.step(turning, period_s, asked_dps, turn_dps, room, drives=drives)
        found[step] = [
            tilt_deg, float(now["rate_corrected_dps"]), velocity_mps, float(now["lean_deg"]), duty, asked_mps,
            asked_dps, turn_dps, loop.bias_dps, rolled_dps, drives * (duty - turn), drives * (duty + turn),
        ]  # fmt: skip
    return found


def run_control(
    tuning: WheelsTuning, raw: npt.ArrayLike, setpoint: npt.ArrayLike | None = None
) -> dict[str, FloatArray]:
    """From counts to duties. raw: counts, then commands, (steps, 9 or more[, runs]), commands that are not given have
    their defaults; setpoint: speed, Q15 (steps[, runs]), default 0. Float arrays (steps[, runs]) by the names NAMES."""
    given = np.asarray(raw, np.float64)
    asked = np.zeros((len(given), *given.shape[2:]))
    if setpoint is not None:
        asked = np.broadcast_to(np.asarray(setpoint, np.float64), asked.shape)
    declared = declarations.system("wheels")
    defaults = np.array([0.0] * declared.counts + list(declared.default_commands()))[given.shape[1] :]
    rest = np.broadcast_to(
        defaults.reshape(-1, *(1,) * (given.ndim - 2)), (len(given), len(defaults), *given.shape[2:])
    )
    whole = np.concatenate([given, rest], axis=1)
    if whole.ndim == 2:
        found = one_run(tuning, whole, asked)
    else:
        runs = range(whole.shape[2])
        found = np.stack([one_run(tuning, whole[:, :, run], asked[:, run]) for run in runs], axis=-1)
    return {name: found[:, i] for i, name in enumerate(NAMES)}
