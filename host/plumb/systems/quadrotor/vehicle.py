"""The vehicles of `quadrotor` in the air: physics, sensors, pilot and receiver of many runs side by side.

Arrays have the runs as their last axis. A period: `advance` with the commands of the rotors, then `counts`, `commands`
and `throttle_q15` of the sample at its end. One run is a batch of one.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import Protocol

import numpy as np
import numpy.typing as npt

from plumb.errors import UsageError
from plumb.physics import pilots
from plumb.physics.airframe import G_MPS2, Airframe, command_for
from plumb.physics.cascade import Cascade
from plumb.physics.elementary import cosine, sine
from plumb.physics.ground import Ground
from plumb.physics.imu import Imu
from plumb.physics.quadrotor import Quadrotor
from plumb.physics.vectors import length
from plumb.physics.wind import Wind
from plumb.spec.arrays import BoolArray, FloatArray
from plumb.systems.quadrotor import courses

SUB_STEPS_US, DELAY_STEPS = (1250, 1000), 2
"""Steps of the physics: the first of which a period is a whole number. The delay of a command in them: 2 ms of the ESC,
and half a millisecond of computing in the longer one."""
FULL_Q15, PLACE_SUM_MOST_MS = 32767, 30.0
STICK_LEAN, STICK_RATE_DPS, STICK_YAW_DPS = math.sin(math.radians(35.0)), 400.0, 180.0
"""What a pilot takes a full stick for: sine of a lean, and rates."""
ROTORS_ON, MODE_RATE = 1, 2
FRAME_S, NUMBERS = 1.0 / 150.0, 255
"""The receiver gets 150 frames a second (CRSF), numbered 1 to 255 in a circle."""


def sub_step_us(period_us: int) -> int:
    """The step of the physics in a period. Raises UsageError for a period that is no whole number of one."""
    for step_us in SUB_STEPS_US:
        if period_us % step_us == 0:
            return step_us
    steps = " or ".join(map(str, SUB_STEPS_US))
    raise UsageError(f"the physics take steps of {steps} us: a period is a whole number of them")


class Drawn(Protocol):
    """The drawn values of a run: `plumb.systems.quadrotor.drawn_run.Scenario`."""

    @property
    def period_us(self) -> int: ...
    @property
    def course(self) -> courses.Course: ...
    @property
    def frame(self) -> Airframe: ...
    @property
    def noise(self) -> FloatArray: ...
    @property
    def sticks(self) -> FloatArray: ...


DRAWS = ("imu", "heading_rad", "wind_rad", "phase_rad", "gusts")
"""Further values, by name."""


def seen_steps(period_s: float) -> int:
    """How many periods late a pilot sees."""
    return max(round(pilots.SEEN_LATE_S / period_s), 1)


def hover_command(frame: Airframe, supply: float) -> float:
    """Command of each rotor in a hover with this share of the full thrust."""
    return float(command_for(np.array(frame.weight_n / frame.thrust_max_n / supply)))


class Vehicles:
    """The bodies of runs of one course, frame and period. ideal: a float cascade on the true attitude flies instead of
    the commands that `advance` is given."""

    def __init__(self, drawn: Sequence[Drawn], *, ideal: bool = False, frame: Airframe | None = None) -> None:
        """frame: instead of the one of the runs."""
        first = drawn[0]
        self.course, self.frame = first.course, first.frame if frame is None else frame
        self.period_s, self.runs, self.step = first.period_us * 1e-6, len(drawn), 0
        self._noise = np.stack([one.noise for one in drawn], -1)
        self._sticks = np.stack([one.sticks for one in drawn], -1)
        draws = {name: np.stack([getattr(one, name) for one in drawn], -1) for name in DRAWS}
        self._phase_rad = draws["phase_rad"]
        self.ground = Ground(self.frame, self.course.slope_rad)
        attitude, self.begin_m = self._placed(draws["heading_rad"])
        self.body = Quadrotor(self.frame, attitude, self.begin_m, self.course.vibration_g)
        self.body.thrust_factor = np.ones((4, self.runs))
        self.wind = Wind(self.course.wind_mps, draws["wind_rad"], draws["gusts"])
        self.imu = Imu(self.course.grade, draws["imu"], self.period_s)
        self._waiting = deque([np.zeros((4, self.runs))] * DELAY_STEPS, maxlen=DELAY_STEPS + 1)
        self._collective = pilots.Collective(self.frame, self.runs, self.period_s)
        self._seen: deque[tuple[FloatArray, FloatArray]] = deque(maxlen=seen_steps(self.period_s))
        self._sum_ms = np.zeros((2, self.runs))
        self._felt = np.zeros((3, self.runs)), self.body.matrix[2].copy()
        self._received_s = -1.0
        self._cascade = Cascade(self.frame, self.runs, self.period_s) if ideal else None
        self._landed_s = np.full(self.runs, np.inf)
        self.lean_rad, self.yaw_radps, self.thrust_n = (
            np.zeros((2, self.runs)),
            np.zeros(self.runs),
            np.zeros(self.runs),
        )
        self.rate_dps: tuple[float, float, float] | None = None
        self._commands, self._throttle = np.zeros((self.runs, 6), np.int16), np.zeros(self.runs, np.int32)
        self._pilot()

    def _placed(self, heading_rad: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Attitudes and places at the beginning."""
        if self.course.lands:
            return self.ground.standing(heading_rad)
        half = heading_rad / 2.0
        zero, w, z = 0.0 * half, np.cos(half), np.sin(half)
        attitude = np.stack([w, zero, zero, z])
        if self.course.on_its_back:  # rolled by half a turn
            attitude = np.stack([zero, w, z, zero])
        return attitude, np.stack([zero, zero, zero + self.course.begin_m])

    @property
    def time_s(self) -> float:
        return self.step * self.period_s

    @property
    def landed(self) -> BoolArray:
        """Runs whose pilot has taken them for landed."""
        return np.asarray(self._landed_s <= self.time_s)

    def advance(self, command: FloatArray) -> None:
        """One period of the physics with the commands of the rotors, 0 to 1, (4, runs)."""
        given = self._ideal_command() if self._cascade is not None else command
        at_s, self.step = self.time_s, self.step + 1
        self.wind.advance(self._noise[self.step % len(self._noise), 6:], self.period_s)
        if at_s >= courses.REST_S - courses.INSTANT_S and not self.course.held:
            self._fly(at_s, given)
        self._pilot()

    def _fly(self, at_s: float, command: FloatArray) -> None:
        body, course = self.body, self.course
        if at_s < courses.REST_S + self.period_s / 2.0 and not course.lands:
            body.spin_up(self.frame.hover_radps, self._phase_rad)
            hover = np.full((4, self.runs), hover_command(self.frame, course.supply))
            self._waiting.extend([hover] * DELAY_STEPS)
            command = hover
        wind_mps, supply = self.wind_mps(at_s), self._happens(at_s)
        sub_step_s = sub_step_us(round(self.period_s * 1e6)) * 1e-6
        steps = round(self.period_s / sub_step_s)
        force, rate = np.zeros((3, self.runs)), np.zeros((3, self.runs))
        for _ in range(steps):
            self._waiting.append(command)
            target = body.target_radps(self._waiting[0], supply)
            force += body.advance(target, wind_mps, sub_step_s, self.ground if course.lands else None)
            rate += body.rate_radps
        self._felt = np.degrees(rate) / steps, force / (G_MPS2 * steps)

    def _happens(self, at_s: float) -> float:
        """Let happen what does in the period from at_s on; gives the share of the full thrust."""
        body, course = self.body, self.course
        body.thrust_factor[:] = 1.0
        for one in course.happenings:
            if one.what == courses.WEAK and one.lasts(at_s):
                body.thrust_factor[one.number] = 1.0 - one.size
            if one.what == courses.KICK and one.lasts(at_s):
                body.rate_radps[0] += one.size * self.period_s / (one.end_s - one.begin_s)
        shaken, sags = course.lasting(courses.SHAKE, at_s), course.lasting(courses.SAG, at_s)
        body.vibration_g = course.vibration_g if shaken is None else shaken.size
        if sags is None:
            return course.supply
        return course.supply * (1.0 - sags.size * min((at_s - sags.begin_s) / courses.SAG_S, 1.0))

    def wind_mps(self, at_s: float | None = None) -> FloatArray:
        """Wind at a time, None: now, earth axes, (3, runs)."""
        gust = self.course.lasting(courses.GUST, self.time_s if at_s is None else at_s)
        wind_mps = self.wind.velocity_mps()
        if gust is not None:
            wind_mps[:2] += gust.size * self.wind.along
        return wind_mps

    def bias_dps(self) -> FloatArray:
        """Of the gyro now, (3, runs)."""
        step = self.course.lasting(courses.BIAS, self.time_s)
        self.imu.stepped_dps = np.zeros((3, 1))
        if step is not None:
            self.imu.stepped_dps[[bool(step.number >> axis & 1) for axis in range(3)]] = step.size
        return self.imu.bias_now_dps(self.time_s)

    def counts(self) -> npt.NDArray[np.int16]:
        """Raw counts of gyro and accelerometer now, (runs, 6)."""
        self.bias_dps()
        return self.imu.counts(self.time_s, *self._felt, self._noise[self.step % len(self._noise), :6])

    def commands(self) -> npt.NDArray[np.int16]:
        """Words of the commands, (runs, 6): those of the receiver's last frame."""
        return self._commands

    def throttle_q15(self) -> npt.NDArray[np.int32]:
        """The throttle of the receiver's last frame, (runs,)."""
        return self._throttle

    def _pilot(self) -> None:
        """What the pilot asks for now; the receiver gets it with its next frame."""
        body, course, now_s = self.body, self.course, self.time_s
        self._seen.append((body.position_m.copy(), body.velocity_mps.copy()))
        position, velocity = self._seen[0]
        position = position - self.begin_m
        flying = now_s >= courses.REST_S
        if flying:
            sum_ms = self._sum_ms + self.period_s * position[:2]
            self._sum_ms = np.clip(sum_ms, -PLACE_SUM_MOST_MS, PLACE_SUM_MOST_MS)
        nose = body.matrix[:2, 0]
        heading = nose / np.maximum(length(nose), 1e-6)
        acts_s = now_s - course.acts_s
        knows = pilots.Seen(max(acts_s, 0.0), position, velocity, heading, self._sticks, self._sum_ms)
        roll, pitch, self.yaw_radps = (pilots.centred if acts_s < 0.0 else course.pilot)(knows)
        self.lean_rad = np.stack([roll, pitch])
        if flying and not course.held:
            self.thrust_n = self._collective.thrust_n(body, *self._height(now_s))
        self.rate_dps = next((one.rate_dps for one in course.turns if one.begin_s <= now_s < one.end_s), None)
        if course.lands and now_s > course.land_at_s:
            touched = self.ground.touched(body.position_m, course.touched_m)
            self._landed_s = np.where(touched, np.minimum(self._landed_s, now_s), self._landed_s)
        frame = int(now_s / FRAME_S + 1e-6)
        if frame * FRAME_S > self._received_s and course.lasting(courses.DEAF, now_s) is None:
            self._received_s = frame * FRAME_S
            self._receive(frame % NUMBERS + 1, flying)

    def _height(self, now_s: float) -> tuple[FloatArray, float]:
        begin_m, course = self.begin_m[2], self.course
        if not course.lands:
            return begin_m, 0.0
        since_s = now_s - courses.REST_S
        if now_s < course.land_at_s:
            rising = since_s * courses.CLIMB_MPS < course.climb_m
            return begin_m + min(since_s * courses.CLIMB_MPS, course.climb_m), courses.CLIMB_MPS if rising else 0.0
        return begin_m + course.climb_m - course.sink_mps * (now_s - course.land_at_s), -course.sink_mps

    def _receive(self, number: int, flying: bool) -> None:
        (roll, pitch), course, now_s = self.lean_rad, self.course, self.time_s
        yaw = np.degrees(self.yaw_radps) / STICK_YAW_DPS
        sticks = [sine(roll) * cosine(pitch) / STICK_LEAN, sine(pitch) / STICK_LEAN, yaw]
        switches = (ROTORS_ON if flying else 0) * (self._landed_s + course.keeps_on_s > now_s)
        if self.rate_dps is not None:
            x, y, z = self.rate_dps
            shape = np.ones(self.runs)
            sticks = [x / STICK_RATE_DPS * shape, y / STICK_RATE_DPS * shape, z / STICK_YAW_DPS * shape]
            switches = switches | MODE_RATE
        words = [np.rint(np.clip(one, -1.0, 1.0) * FULL_Q15) for one in sticks]
        zero = np.zeros(self.runs)
        self._commands = np.stack([*words, switches + zero, zero + number, zero], 1).astype(np.int16)
        share = command_for(self.thrust_n / (self.frame.thrust_max_n * course.supply)) if flying else zero
        given = course.lasting(courses.THROTTLE, now_s)
        if given is not None:
            share = zero + given.size
        low = self.landed | (course.lasting(courses.CUT, now_s) is not None)
        self._throttle = np.where(low, 0, np.rint(share * FULL_Q15)).astype(np.int32)

    def _ideal_command(self) -> FloatArray:
        """The commands of a float controller that knows the truth."""
        body, flying = self.body, np.asarray(~self.landed)
        if self.time_s < courses.REST_S - 1e-9:
            return np.zeros((4, self.runs))
        assert self._cascade is not None
        up = np.ascontiguousarray(body.matrix[2])
        wanted = pilots.vertical(*self.lean_rad) if self.rate_dps is None else up
        command = self._cascade.command(up, wanted, self.yaw_radps, body.rate_radps, self.thrust_n, flying)
        return np.where(flying, command, 0.0)

    def overturned(self) -> BoolArray:
        """Runs that lean by more than a right angle."""
        return np.asarray(self.body.matrix[2, 2] < 0.0)
