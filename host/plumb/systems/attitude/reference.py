"""`attitude` in float64: the equations as docs/systems/attitude.md derives them, block by block.

The same blocks, the same order of the measurements and the same delays as the integers have, and none of their
rounding: what a block has shown corrects the attitude in the first step of the next one, and is judged in the second.
The filter counts in units in which the integers do, so that one limit of variance serves all states: a bias in 1/4
rad/s, a scale error in 1/64, a tilt in rad, a velocity in 2 g s.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from plumb.kernels.reference.kernels import calibrate
from plumb.spec.arrays import FloatArray
from plumb.systems.attitude import reference_shock as shock
from plumb.systems.attitude.quantise import BIAS_UNITS, DEG, G_MPS2, LEAST_STEPS, SCALE_UNITS, SPEED_UNITS
from plumb.systems.attitude.reference_state import (
    CORRECTS,
    DONE,
    JUDGES,
    VARIANCE_LIMIT,
    VELOCITY_ADDED_G2S2,
    Filter,
    Samples,
    Sums,
)
from plumb.systems.attitude.reference_turns import matrices, right_products, to_vertical, turned
from plumb.systems.attitude.tuning import AttitudeTuning
from plumb.tuning.channels import NO_SAMPLE

ALIGNING_BLOCKS = 4
WORTHLESS_G, WORTHLESS_GS = 0.15, 1.0 / 32.0
"""An acceleration, and the integral of one over a block, below which it has no usable direction."""
GATE = 25.0
TILT_STEP_RAD, HALF_ANGLE_RAD, VELOCITY_GS = 0.25, 0.43, 4.0
VELOCITY_UNIT_GS = 2.0
"""What 1 of the filter's velocities is."""
SPEED_LIMIT_G2S2 = 32.0
"""Largest variance with which the velocity is measured to be zero."""
REST_SPEED_GS = 2.5
"""A body at rest is not as fast."""
LONG_RESTS = 7
"""A steady acceleration does not last for so many rests."""
TRAVEL_HOLD = 0.3
"""A smaller excess is no travel; it is remembered for 1 / 0.3 of the time that shows it."""
LONGEST_RUN = 255
BRIDGED_RAD, BRIDGED_G, BRIDGED_SUM_G = 0.43, 1200.0, 2100.0
LASTING_PER_S = (1.0 / 128.0, 0.5)
"""What a velocity that lasts says of the tilt, by g s: on the ground, in flight."""
FLIGHT_LEAST_RAD, NEWEST_PER_S, KEPT = np.radians(1.5), np.sqrt(1.0 / 8.0), 7.0 / 8.0
"""In flight the stated deviation is at least so much, the newest difference of the velocities says so much of the tilt,
by g s, and a block keeps so much of the variance."""
LASTING_MOST_RAD2 = 1.0 / 8.0
FILTER_SHARE, CORRECTED_GAIN, CORRECTED_MOST = 3.0 / 16.0, 1.5, 6.0
"""The stated variance: share of the filter's own; gain of the square of what was corrected in one direction, at most so
many times the filter's own."""
CORRECTED_RAD = 0.5
BIAS_RADPS, SCALE = np.pi / 2.0, 1.0 / 16.0
UNITS = np.array([BIAS_UNITS] * 3 + [SCALE_UNITS] * 3)
BIASES, SCALES, TILTS, VELOCITIES = slice(0, 3), slice(3, 6), slice(6, 8), slice(8, 10)


class Model:
    """The filter of one tuning."""

    def __init__(self, tuning: AttitudeTuning, *, vehicle: bool = False) -> None:
        """vehicle: take-off and landing are followed also without an aid."""
        self.vehicle, self.aided = vehicle, tuning.aid.drag_per_s > 0.0
        self.tuning, self.period_s = tuning, tuning.period_s
        self.steps = max(round(tuning.block_s / self.period_s), LEAST_STEPS)
        self.block_s = self.steps * self.period_s
        e, m, block_s = tuning.errors, tuning.motion, self.block_s
        self.start_variance = np.array(
            [(BIAS_UNITS * DEG * e.bias_dps) ** 2] * 3
            + [(SCALE_UNITS * e.scale) ** 2] * 3
            + [(DEG * m.start_tilt_deg) ** 2] * 2
            + [(m.start_velocity_mps * SPEED_UNITS) ** 2] * 2
        )
        self.growth = np.zeros(10)
        self.growth[BIASES] = (BIAS_UNITS * DEG * e.bias_walk_dps) ** 2 * block_s
        self.growth[SCALES] = (SCALE_UNITS * e.scale_walk) ** 2 * block_s
        self.rest_blocks = max(round(tuning.rest.seconds / block_s), 1)
        self.travel_gain = 2.0 * m.travel_s / block_s
        self.rest_variance = (BIAS_UNITS * DEG * tuning.rest.noise_dps) ** 2

    def begun(self) -> Filter:
        """The state before the first sample."""
        x = Filter(np.diag(self.start_variance), tilt_rad2=2.0 * float(self.start_variance[6]))
        x.flight.hover, x.aided = self.tuning.aid.hover, self.aided
        return x

    def restarted(self, x: Filter) -> Filter:
        """The state of a new start; it goes on with the attitude, which its blocks align."""
        fresh = self.begun()
        fresh.attitude, fresh.started = x.attitude, True
        fresh.half_before, fresh.accel_before = x.half_before, x.accel_before
        fresh.force_before, fresh.half_mean = x.force_before, x.half_mean
        fresh.gap, fresh.runs, fresh.slopes = x.gap, x.runs, x.slopes
        fresh.measured_gs, fresh.flight = x.measured_gs, x.flight
        fresh.block_step, fresh.turning_rad = x.block_step, x.turning_rad
        return fresh

    def taken(self, counts: FloatArray, thrust: FloatArray) -> Samples:
        """Counts (steps, 6) in body axes, thrust commands (steps,); what is missing repeats the acceleration before."""
        gyro, accel = self.tuning.gyro, self.tuning.accel
        rate = np.radians(calibrate(counts[:, :3], gyro)) @ np.array(self.tuning.gyro_mounting.matrix).T
        force = calibrate(counts[:, 3:], accel) @ np.array(self.tuning.accel_mounting.matrix).T
        missing = counts[:, 0] == NO_SAMPLE
        last = np.maximum.accumulate(np.where(missing, -1, np.arange(len(counts))))
        force = np.where(last[:, None] < 0, 0.0, force[np.maximum(last, 0)])
        clipped = [
            ((part < channel.min_counts) | (part > channel.max_counts)).any(axis=1) & ~missing
            for part, channel in ((counts[:, :3], gyro), (counts[:, 3:], accel))
        ]
        at_limit = np.cumsum(clipped[1])
        in_a_row = at_limit - np.maximum.accumulate(np.where(clipped[1] | missing, 0, at_limit))  # up to this step
        rates_alone = clipped[1] & ((counts[:, 3:] == NO_SAMPLE).all(axis=1) | (in_a_row > 2 * self.steps))
        return Samples(rate, force, thrust, missing, clipped[0], clipped[1], rates_alone)

    def half_angles(self, x: Filter, samples: Samples) -> FloatArray:
        """Half the angles of each step; a missing one turns as the step before."""
        rate = (1.0 - x.scale) * samples.rate - x.bias_radps
        half = np.clip(rate * (self.period_s / 2.0), -HALF_ANGLE_RAD, HALF_ANGLE_RAD)
        if samples.missing.any():
            both = np.concatenate([x.half_before[None], half])
            last = np.maximum.accumulate(np.where(samples.missing, 0, np.arange(1, len(half) + 1)))
            half = both[last]
        return np.asarray(half)

    def accelerations(self, x: Filter, samples: Samples) -> FloatArray:
        """Where none came: 1 g upwards as the step before has it, which leaves the velocity of the block unknown."""
        if not samples.rates_alone.any():
            return samples.accel
        x.sums.add_variance(0.0, VELOCITY_ADDED_G2S2)
        accel, q = samples.accel.copy(), x.attitude
        half = self.half_angles(x, samples)
        before = np.concatenate([x.half_before[None], half[:-1]]) if x.started else half
        for step, product in enumerate(right_products(half + np.cross(before / 6.0, half))):
            if samples.rates_alone[step]:
                accel[step] = matrices(q[None])[0][2] if x.started else 0.0
            elif samples.missing[step] and step:
                accel[step] = accel[step - 1]
            q = product @ q
        return accel

    def summed(self, x: Filter, samples: Samples) -> FloatArray:
        """Turns the attitude through the samples, adds them to the sums; the attitude after each step (n, 4)."""
        half, accel, sums = self.half_angles(x, samples), self.accelerations(x, samples), x.sums
        strong = np.linalg.norm(accel, axis=1) >= WORTHLESS_G
        begin = 0 if x.started else int(np.argmax(strong)) if strong.any() else len(half)
        alone = np.arange(len(half)) <= (-1 if x.started else begin)  # steps that have none before them
        half_before = np.where(alone[:, None], half, np.concatenate([x.half_before[None], half[:-1]]))
        accel_before = np.where(alone[:, None], accel, np.concatenate([x.accel_before[None], accel[:-1]]))
        if not x.started:
            x.half_mean = half[min(begin, len(half) - 1)]
        mean = np.where(alone[:, None], half, x.half_mean)
        coned = half + np.cross(half_before / 6.0, half)
        products, attitudes, q = right_products(coned), np.empty((len(half), 4)), x.attitude
        for step, product in enumerate(products):
            by = (half[step] - half_before[step], accel[step] - accel_before[step])
            gap, force = 0, np.zeros(3)
            if samples.missing[step]:
                x.gap = min(x.gap + 1, LONGEST_RUN)
            else:
                gap, x.gap = x.gap, 0
                if gap and x.started:
                    q, force = self.bridge(sums, gap, q, *by)
                if x.started:
                    self.count_clipped(x, by, (bool(samples.gyro_clipped[step]), bool(samples.accel_clipped[step])))
            if not x.started and step == begin:
                q, x.started = turned(to_vertical(accel[step]), q), True
            attitudes[step] = q = product @ q
            x.bridged = gap > 0
            if x.bridged:
                sums.force = np.clip(sums.force + matrices(q[None])[0] @ force, -BRIDGED_SUM_G, BRIDGED_SUM_G)
        x.attitude, x.half_before, x.accel_before = q, half[-1], accel[-1]

        matrix = matrices(attitudes)
        moved_to_end = accel + np.cross(half_before / 3.0 - 2.0 * half, accel) / 2.0
        sculled = moved_to_end + np.cross(accel_before, half) / 6.0
        sums.half, sums.square = sums.half + half.sum(axis=0), sums.square + float(np.sum(half**2))
        sums.force = sums.force + np.einsum("nij,nj->i", matrix, sculled)
        sums.thrust_force = sums.thrust_force + np.einsum("ni,n->i", matrix[:, :2, 2], sculled[:, 2])
        sums.rows = sums.rows + matrix[:, :2].sum(axis=0)
        sums.turned = sums.turned + np.einsum("nij,nj->ij", matrix[:, :2], half)
        still_rad = DEG * self.tuning.rest.gyro_dps * self.period_s / 2.0
        sums.moved = sums.moved or bool((np.abs(half - mean) > still_rad).any())
        sums.thrust = float(samples.thrust[-1])
        return attitudes

    def bridge(
        self, sums: Sums, steps: int, attitude: FloatArray, by_half: FloatArray, by_accel: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """The attitude after a gap: the held turn becomes that of a straight line between the samples on both sides;
        and the acceleration that the gap adds, in body axes.

        The variance is that of a random walk between them, (time * difference)^2 / 12, and half as much again.
        """
        by = np.clip(by_half * steps / 4.0, -BRIDGED_RAD, BRIDGED_RAD)
        half_way = right_products(by[None])[0]
        bridged: FloatArray = half_way @ (half_way @ attitude)
        sums.add_variance(
            steps**2 * float(by_half @ by_half) / 2.0,
            (steps * self.period_s) ** 2 * float(by_accel @ by_accel) / 8.0,
        )
        return bridged, np.clip(by_accel * (steps / 2.0), -BRIDGED_G, BRIDGED_G)

    def count_clipped(self, x: Filter, by: tuple[FloatArray, FloatArray], clipped: tuple[bool, bool]) -> None:
        """Samples in a row at a limit: what they hide is between nothing and a parabola, time^2 slope / 6, with the
        larger slope of both ends."""
        hidden = [0.0, 0.0]
        for sensor, (change, at_limit) in enumerate(zip(by, clipped, strict=True)):
            steps, square = x.runs[sensor], float(change @ change)
            x.runs[sensor] = min(steps + 1, LONGEST_RUN) if at_limit else 0
            if at_limit and not steps:
                x.slopes[sensor] = square
            elif steps and not at_limit:
                hidden[sensor] = steps**4 * max(square, x.slopes[sensor]) / 108.0
        x.sums.add_variance(4.0 * hidden[0], hidden[1] * self.period_s**2)

    def closed(self, x: Filter) -> None:
        """The last step of a block: what it has gained, how the errors have grown in it, whether it rests."""
        rest, steps, sums = self.tuning.rest, self.steps, x.sums
        x.mean_radps = 2.0 * sums.half / self.block_s
        moved = sums.moved or x.airborne or bool((np.abs(sums.force - x.force_before) > rest.accel_g * steps).any())
        moved = moved or bool((np.abs(x.mean_radps) > DEG * rest.turn_dps).any())
        if x.aligned_blocks >= ALIGNING_BLOCKS:
            shock.note_turn(x, self.tuning, steps)
        x.force_before, x.half_mean = sums.force, sums.half / steps
        x.still_blocks = 0 if moved else min(x.still_blocks + 1, LONG_RESTS * self.rest_blocks)
        x.sums, x.block_step = Sums(), 0
        gained_gs = sums.force * self.period_s
        if x.aligned_blocks < ALIGNING_BLOCKS:
            self.align(x, gained_gs)
            return
        x.transition = self.transition(sums, float(gained_gs[2]))
        x.velocity_gs = x.velocity_gs + gained_gs[:2]
        jumped = self.measure_velocity(x, sums, gained_gs)
        x.growth = self.growth.copy()
        x.growth[TILTS] = self.tilt_growth(x, sums)
        x.growth[VELOCITIES] = (VELOCITY_ADDED_G2S2 if jumped else sums.velocity_added_g2s2) / VELOCITY_UNIT_GS**2
        x.left, x.rested = CORRECTS, x.rested or x.still_blocks >= self.rest_blocks

    def advanced(self, x: Filter, samples: Samples, begin: int, end: int) -> tuple[Filter, FloatArray]:
        """The state after these steps of a block, and the attitude after each of them (n, 4)."""
        closes = x.block_step + end - begin == self.steps
        if closes and samples.missing[end - 2]:  # the last step of a block takes no sample after a gap
            samples.miss(end - 1)
        attitudes = self.summed(x, samples.part(begin, end))
        x.block_step += end - begin
        if not x.bridged:
            x = self.taken_up(x)
        if closes:
            self.closed(x)
        attitudes[-1] = x.attitude
        return x, attitudes

    def taken_up(self, x: Filter) -> Filter:
        """The state after a step that does what is left of the last block."""
        if x.left == JUDGES:
            return self.judged(x)
        if x.left == CORRECTS:
            self.correct(x)
            x.left = JUDGES
        return x

    def align(self, x: Filter, gained_gs: FloatArray) -> None:
        """The vertical is the mean acceleration of all blocks so far."""
        total = gained_gs + np.array([*x.velocity_gs, x.upwards_gs])
        length = float(np.linalg.norm(total))
        if length >= WORTHLESS_GS:
            x.attitude = turned(to_vertical(total), x.attitude)
        x.velocity_gs = np.zeros(2)
        x.aligned_blocks += 1
        x.upwards_gs = length if x.aligned_blocks < ALIGNING_BLOCKS else 0.0

    def transition(self, sums: Sums, upwards_gs: float) -> FloatArray:
        """How the errors at the end of the block follow from those at its begin, (10, 10)."""
        half_lever, grown, tilted = np.eye(10), np.eye(10), np.eye(10)
        lever = float(np.clip(upwards_gs, self.block_s / 2.0, 2.0 * self.block_s)) / 2.0
        half_lever[8, 7], half_lever[9, 6] = lever / VELOCITY_UNIT_GS, -lever / VELOCITY_UNIT_GS
        tilted[TILTS, BIASES] = -sums.rows * self.period_s / BIAS_UNITS
        tilted[TILTS, SCALES] = -2.0 * sums.turned / SCALE_UNITS
        grown[:] = half_lever @ tilted @ half_lever
        return grown

    def velocity_variance(self, x: Filter) -> float:
        """How far the velocity is trusted to be zero, g^2 s^2; a velocity that lasts is remembered as travel."""
        motion = self.tuning.motion
        x.square_g2s2 += self.block_s / motion.pass_s * (float(x.velocity_gs @ x.velocity_gs) - x.square_g2s2)
        off_gs = np.clip(x.velocity_gs - x.measured_gs, -VELOCITY_GS, VELOCITY_GS)
        x.travel_gs = x.travel_gs + self.block_s / motion.travel_s * (off_gs - x.travel_gs)
        if x.airborne:
            x.travel_excess_g2s2 = 0.0
            return (self.tuning.aid.velocity_mps / G_MPS2) ** 2
        explained = VELOCITY_UNIT_GS**2 * float(x.covariance[8, 8] + x.covariance[9, 9])
        excess = float(x.travel_gs @ x.travel_gs) - explained - (motion.travel_mps / G_MPS2) ** 2
        x.travel_excess_g2s2 *= 1.0 - TRAVEL_HOLD * self.block_s / motion.travel_s
        x.travel_excess_g2s2 = max(x.travel_excess_g2s2, excess, 0.0)
        least = (motion.velocity_mps / G_MPS2) ** 2
        moving = motion.share * x.square_g2s2 + self.travel_gain * x.travel_excess_g2s2
        return min(least + moving, SPEED_LIMIT_G2S2)

    def measure_velocity(self, x: Filter, sums: Sums, gained_gs: FloatArray) -> bool:
        """What the velocity is measured to be at the end of a block: zero, or in flight that of the rotors' drag.

        Returns whether neither is known: it has taken off or landed, or the ground may carry it.
        """
        aid, before = self.tuning.aid, x.airborne
        x.measured_gs, mean_g = np.zeros(2), gained_gs / self.block_s
        if self.aided or self.vehicle:
            x.flight.follow(mean_g, sums.thrust, self.block_s, felt=x.runs[1] == 0)
        if not self.aided:
            return False
        if x.airborne:
            across_g = mean_g[:2] - sums.thrust_force / self.steps
            x.measured_gs = np.clip(-across_g / aid.drag_per_s + gained_gs[:2] / 2.0, -VELOCITY_GS, VELOCITY_GS)
        if x.airborne != before:
            x.travel_gs = np.zeros(2)
        return x.airborne != before or (x.airborne and x.flight.carried_blocks > 0)

    def tilt_growth(self, x: Filter, sums: Sums) -> float:
        """How much the tilt has become uncertain in a block, rad^2."""
        errors = self.tuning.errors
        turned_rad2 = 4.0 * sums.square / self.period_s
        lasting_m2ps2 = G_MPS2**2 * float(x.travel_gs @ x.travel_gs) - self.tuning.motion.velocity_mps**2
        stays = not x.airborne and x.travel_excess_g2s2 <= shock.TRAVELS_G2S2
        doubt2 = errors.turn_doubt**2 * max(lasting_m2ps2, 0.0) if stays else 0.0
        blind = max(x.gap, x.runs[0]) >= self.steps
        growth = (DEG * errors.noise_dps) ** 2 * self.block_s + (errors.turn_noise**2 + doubt2) * turned_rad2
        return growth + sums.tilt_added_rad2 + ((DEG * errors.clipped_deg) ** 2 if blind else 0.0)

    def correct(self, x: Filter) -> None:
        """The correction of the block before, brought to the end of the last one."""
        d = x.transition @ x.correction
        x.bias_radps = np.clip(x.bias_radps + d[BIASES] / BIAS_UNITS, -BIAS_RADPS, BIAS_RADPS)
        x.scale = np.clip(x.scale + d[SCALES] / SCALE_UNITS, -SCALE, SCALE)
        tilt = np.array([*np.clip(d[TILTS], -TILT_STEP_RAD, TILT_STEP_RAD), 0.0])
        kept = 1.0 - TRAVEL_HOLD * self.block_s / self.tuning.motion.travel_s
        x.corrected_rad = np.clip(kept * x.corrected_rad + d[TILTS], -CORRECTED_RAD, CORRECTED_RAD)
        x.attitude = turned(np.array([1.0, *(tilt / 2.0)]), x.attitude)
        x.attitude /= np.linalg.norm(x.attitude)
        x.force_before = x.force_before + np.cross(tilt, x.force_before)
        x.velocity_gs = x.velocity_gs + VELOCITY_UNIT_GS * d[VELOCITIES]

    def stated_rad2(self, x: Filter) -> float:
        """The stated variance of the tilt."""
        in_flight = self.tuning.aid.drag_per_s > 0.0 and not x.flight.landed
        own = float(x.covariance[6, 6] + x.covariance[7, 7])
        lasting = (float(np.linalg.norm(x.travel_gs)) * LASTING_PER_S[in_flight]) ** 2
        if not in_flight:
            corrected = CORRECTED_GAIN * float(x.corrected_rad @ x.corrected_rad)
            return FILTER_SHARE * own + min(corrected, CORRECTED_MOST * own) + lasting
        newest = (float(np.linalg.norm(x.velocity_gs - x.measured_gs)) * NEWEST_PER_S) ** 2
        shown = min(lasting, LASTING_MOST_RAD2) + min(newest, LASTING_MOST_RAD2 / 2.0)
        return float(max(FLIGHT_LEAST_RAD**2 + FILTER_SHARE * own + shown, KEPT * x.tilt_rad2))

    def judged(self, x: Filter) -> Filter:
        """What the last block has shown; then its measurements, or a new start."""
        v = np.clip(x.velocity_gs, -VELOCITY_GS, VELOCITY_GS)
        x.velocity_gs = v if x.airborne else v * (1.0 - self.block_s / self.tuning.motion.leak_s)
        variance = self.velocity_variance(x) / VELOCITY_UNIT_GS**2
        x.tilt_rad2 = self.stated_rad2(x)

        resting, x.left = x.still_blocks >= self.rest_blocks, DONE
        risen_g = 1.0 - float(x.force_before[2]) / self.steps - x.rise_g
        x.rise_g = 0.0 if not x.flight.landed else x.rise_g + self.block_s / self.tuning.motion.travel_s * risen_g
        long = x.still_blocks == LONG_RESTS * self.rest_blocks
        fast = long and float(np.linalg.norm(x.velocity_gs)) > REST_SPEED_GS
        held = x.rested and shock.held_still(x, self.rest_blocks, self.steps)
        if x.flight.landed and resting and (fast or shock.tilted_at_rest(x.force_before / self.steps)):
            return self.restarted(x)
        if held or shock.lost_in_motion(x, self.tuning, self.block_s):
            shock.reopen(x, self.start_variance, self.growth)
            resting = resting or held
        x.covariance = x.transition @ x.covariance @ x.transition.T
        growth = x.growth
        if x.travel_excess_g2s2 > shock.TRAVELS_G2S2:  # a bias looks like travel
            growth[BIASES] = 0.0
        diagonal = np.diagonal(x.covariance)
        x.covariance = x.covariance + np.diag(
            np.where(diagonal < VARIANCE_LIMIT, np.minimum(growth, VARIANCE_LIMIT), 0)
        )
        x.correction = np.zeros(10)
        for axis in range(2):
            measure(x, 8 + axis, float(x.measured_gs[axis] - x.velocity_gs[axis]) / VELOCITY_UNIT_GS, variance)
        if resting:
            for axis in range(3):
                measure(x, axis, float(x.mean_radps[axis]) * BIAS_UNITS, self.rest_variance, gated=True)
        return x


def measure(x: Filter, at: int, measured: float, variance: float, *, gated: bool = False) -> None:
    """Kalman filter: the error of state `at` is `measured`, of that variance. Beyond its sigmas a gated one is left
    out."""
    row = x.covariance[at].copy()
    total, innovation = row[at] + variance, float(np.clip(measured - x.correction[at], -1.0, 1.0))
    if gated and innovation**2 > GATE * total:
        return
    x.correction = x.correction + row / total * innovation
    x.covariance = x.covariance - np.outer(row, row) / total


NAMES = (
    *(f"attitude_{part}" for part in "wxyz"),
    *(f"up_{axis}" for axis in "xyz"),
    *(f"bias_dps_{axis}" for axis in "xyz"),
    *(f"scale_{axis}" for axis in "xyz"),
    *(f"velocity_gs_{axis}" for axis in "xy"),
    "tilt_sigma_deg",
)


def known_of(x: Filter) -> list[float]:
    """The columns NAMES behind the vertical."""
    return [*x.bias_radps / DEG, *x.scale, *x.velocity_gs, float(np.sqrt(max(x.tilt_rad2, 0.0))) / DEG]


def one_run(tuning: AttitudeTuning, counts: FloatArray, thrust: FloatArray) -> FloatArray:
    """The columns NAMES of one run, (steps, names). thrust: commands, share of the most, (steps,)."""
    model = Model(tuning)
    x, samples = model.begun(), model.taken(counts, thrust)
    found = np.empty((len(counts), len(NAMES)))
    begin, known = 0, known_of(x)
    while begin < len(counts):
        last = begin + model.steps - x.block_step - 1
        end = min(begin + 1 if x.left else last + 1, len(counts))
        x, attitudes = model.advanced(x, samples, begin, end)
        found[begin:end, :4], found[begin:end, 4:7] = attitudes, matrices(attitudes)[:, 2]
        found[begin : end - 1, 7:] = known
        found[end - 1, 7:] = known = known_of(x)
        begin = end
    return found


def run_control(
    tuning: AttitudeTuning, raw: npt.ArrayLike, setpoint: npt.ArrayLike | None = None
) -> dict[str, FloatArray]:
    """From counts to the attitude. raw: (steps, 6[, runs]); setpoint: thrust command of a
    vehicle, Q15 (steps[, runs]); None: no vehicle.

    Returns float arrays (steps[, runs]) by name: attitude_w.., up_x.., bias_dps_x.., scale_x.., velocity_gs_x, _y, and
    tilt_sigma_deg, the root of the sum of the variances of both axes.
    """
    counts = np.asarray(raw, np.float64)
    thrust = np.zeros((len(counts), *counts.shape[2:]))
    if setpoint is not None:
        thrust = np.broadcast_to(np.asarray(setpoint, np.float64) / 2.0**15, thrust.shape)
    if counts.ndim == 2:
        found = one_run(tuning, counts, thrust)
    else:
        runs = range(counts.shape[2])
        found = np.stack([one_run(tuning, counts[:, :, run], thrust[:, run]) for run in runs], axis=-1)
    return {name: found[:, i] for i, name in enumerate(NAMES)}
