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
from plumb.systems.wheels.settings import Turning
from plumb.systems.wheels.tuning import WheelsTuning

NAMES = (
    "tilt_deg", "rate_corrected_dps", "velocity_mps", "lean_deg", "duty", "asked_mps", "asked_dps", "turn_rate_dps",
    "turn_bias_dps", "turn_wheels_dps", "duty_left", "duty_right",
)  # fmt: skip
FULL = 2.0**15
STOPPED, RIDDEN, STOPPING = range(3)
BIAS_MOST_DPS, APART_MOST_MPS, UP_LEAST_G = 180.0, 8.0, 0.5
CLOSED_TAKES = 4
"""Open steps that a closed step of the rider's switch outweighs."""
KEPT_IN_SLIP = 31.0 / 32.0
"""Share of the integral that a step with a slipping wheel leaves."""


@dataclass
class Rider:
    """Whether somebody rides, and the receiver; times in steps."""

    absent: int
    phase: int = STOPPED
    phase_steps: int = 0
    number: int = 0
    age: int = 0

    def receives(self, tuning: WheelsTuning, receiver: int) -> bool:
        """Whether frames come from the receiver, or none is in use."""
        number = receiver & 255
        self.age = self.age + 1 if number and number == self.number else 0
        self.number = number
        late = self.age >= round(tuning.riding.lost_s / tuning.period_s)
        return not number or not (receiver & 256 or late)

    def step(self, tuning: WheelsTuning, present: bool, blind: bool, tilt_deg: float, on: bool) -> int:
        """The phase of this step."""
        riding, before = tuning.riding, self.phase
        full = round(riding.absent_s / tuning.period_s)
        self.absent = max(self.absent - CLOSED_TAKES, 0) if present else min(self.absent + 1, full)
        rides = present and self.absent == 0 and not blind
        self.phase_steps += 1
        if not on:
            self.phase = STOPPED
        elif before == STOPPED:
            if rides and abs(tilt_deg) <= riding.up_deg:
                self.phase = RIDDEN
        elif before == RIDDEN:
            if self.absent >= full or blind:
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
    """Bias of the gyro, slip of a wheel, loop of the turn rate. slip: steps for which a wheel still slips; excess: what
    balance left of the demand in the step before."""

    bias_dps: float = 0.0
    slip: int = 0
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

    def both(self, left: float, right: float, turned: float, felt: float, dead: tuple[bool, bool]) -> float:
        """Counts of both wheels in this step; while one slips, those of one and of the turn that the gyro feels: of the
        wheel that is nearer to what is felt, counts of both in a step; of the one that counts where the other one is
        dead."""
        by_one = 2.0 * left + turned, 2.0 * right - turned
        if dead[0] != dead[1]:
            return by_one[0] if dead[1] else by_one[1]
        return min(by_one, key=lambda counts: abs(counts - felt)) if self.slip else left + right

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


@dataclass
class Watch:
    """What accelerometer and wheels say of each other; times in steps. apart_mps: speed felt less that of the wheels;
    lies: the motors stay off until the switch is off."""

    apart_mps: float = 0.0
    since: tuple[int, int] = (0, 0)
    rocked_deg: float = 0.0
    full: int = 0
    still: int = 0
    lies: bool = False
    stopped: bool = False
    drives: bool = False

    def dead(self, tuning: WheelsTuning) -> tuple[bool, bool]:
        """Of each wheel: whether it has not counted for long."""
        left, right = (steps >= round(tuning.watching.dead_s / tuning.period_s) for steps in self.since)
        return left, right

    def blind(self, tuning: WheelsTuning, repeats: bool) -> bool:
        """Whether the accelerometer has repeated its counts for too long."""
        self.still = self.still + 1 if repeats else 0
        return self.still >= round(tuning.watching.still_s / tuning.period_s)

    def step(
        self, tuning: WheelsTuning, felt_deg: float, rate_dps: float, velocity_mps: float, duty: float,
        wheels: tuple[float, float],        *, on: bool,
    ) -> bool:  # fmt: skip
        """Whether the encoders, or the ground, lie. felt_deg: difference of the felt tilt from the estimated one; duty:
        for balance."""
        watching, period_s = tuning.watching, tuning.period_s
        drives = self.drives = on and not self.stopped
        change_mps = math.radians(felt_deg) * balancer.GRAVITY_MPS2 * period_s
        apart = self.apart_mps + math.expm1(-period_s / watching.apart_tau_s) * self.apart_mps - change_mps
        self.apart_mps = min(max(apart, -APART_MOST_MPS), APART_MOST_MPS) if drives else 0.0
        left, right = (
            0 if not drives else 1 if one else steps + (steps > 0)
            for steps, one in zip(self.since, wheels, strict=True)
        )
        self.since, counts = (left, right), any(wheels)
        self.rocked_deg = self.rocked_deg + abs(rate_dps) * period_s if drives and not counts else 0.0
        full = drives and counts and abs(duty) >= 0.875 * tuning.balance.drive.duty_max
        self.full = self.full + 1 if full else 0
        rocks = min(self.since) >= round(watching.dead_s / period_s) and self.rocked_deg > watching.rocked_deg
        moves = drives and not any(self.since) and abs(velocity_mps + self.apart_mps) > watching.apart_mps
        self.lies = on and (self.lies or rocks or moves or self.full >= round(watching.full_s / period_s))
        return self.lies


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
    state, loop, watch = balancer.BalancerReferenceState(kernels.kalman_init(own.start)), TurnLoop(), Watch()
    rider = Rider(round(tuning.riding.absent_s / period_s))
    outside = np.any(
        [
            (raw[:, place] < channel.min_counts) | (raw[:, place] > channel.max_counts)
            for place, channel in ((1, axis.accel), (2, axis.accel_up))
        ],
        axis=0,
    )
    repeats = np.any(np.diff(raw[:, 1:3], axis=0, prepend=np.inf) == 0.0, axis=1)
    found, tilt_deg, velocity_mps = np.zeros((len(raw), len(NAMES))), 0.0, 0.0
    wheel, hall, edges_mps = balancer.WheelState(), 0.0, own.wheel.edge_m / period_s
    for step, (roll, pitch, yaw, switches, receiver) in enumerate(raw[:, 9:14].astype(int).tolist()):
        receiving = rider.receives(tuning, receiver)
        on = not rider.number or bool(switches & 1)
        odd = step > 0 and bool(outside[step - 1])
        odd = odd or (rider.phase != STOPPED and float(accel_z_g[step - 1]) < UP_LEAST_G)
        blind = watch.blind(tuning, odd or bool(repeats[step]))
        phase = rider.step(tuning, bool(raw[step, 6] > 0), blind, tilt_deg, on)
        obeys = phase == RIDDEN and receiving
        speed = float(pitch if rider.number else setpoint[step])
        asked_mps = obeys * float(np.clip(speed / FULL, -1.0, 1.0)) * own.speed.speed_max_mps
        asked_dps = obeys * float(np.clip((yaw - roll) / FULL, -1.0, 1.0)) * turning.rate_max_dps
        if phase == STOPPED:
            state.speed, state.pid = PidState(), PidState()
        rolled_dps, turn_dps = loop.measure(turning, period_s, float(up_dps[step]), float(right[step] - left[step]))
        turned = float(np.rint(turn_dps / (math.degrees(turning.count_m / turning.track_m) / period_s)))
        felt = (velocity_mps + watch.apart_mps) / edges_mps if watch.drives else 0.0
        hall = (hall + loop.both(float(left[step]), float(right[step]), turned, felt, watch.dead(tuning))) % 65536.0
        has_mps = velocity_mps
        _, velocity_mps, wheel_g = balancer.wheel_step(wheel, own.wheel, period_s, hall)
        gravity_g, up_g = float(accel_x_g[step]) + wheel_g, float(accel_z_g[step])
        z_deg, r_deg2 = kernels.tilt(gravity_g, up_g, own.tilt), kernels.trust(gravity_g, up_g, own.trust)
        z_deg = tilt_deg if blind or odd else z_deg
        wanted_mps = asked_mps
        if loop.slip:
            wanted_mps = min(max(asked_mps, has_mps - turning.slip_mps), has_mps + turning.slip_mps)
        now = balancer.control_step(
            state, own, float(rate_dps[step]), float(z_deg), float(r_deg2), velocity_mps, wheel_g, wanted_mps
        )
        tilt_deg, duty = float(now["tilt_deg"]), float(now["duty"])
        felt_deg = float(kernels.wrap(float(z_deg) - tilt_deg))
        rate = float(now["rate_corrected_dps"])
        lies = watch.step(tuning, felt_deg, rate, velocity_mps, duty, (float(left[step]), float(right[step])), on=on)
        drives = phase != STOPPED and not state.fallen and not lies
        watch.stopped = (on and not drives) or bool(state.fallen)
        if loop.slip:
            duty = min(max(2.0 * duty, -own.drive.duty_max), own.drive.duty_max)
        room = min(own.drive.duty_max - abs(duty), turning.duty_max)
        turn = loop.step(turning, period_s, asked_dps, turn_dps, room, drives=drives)
        found[step] = [
            tilt_deg, rate, velocity_mps, float(now["lean_deg"]), duty, asked_mps,
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
