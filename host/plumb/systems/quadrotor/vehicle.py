"""The vehicles of `quadrotor` in the air: physics, sensors, pilot and receiver of many runs side by side.

Arrays have the runs as their last axis. A period: `advance` with the commands of the rotors, then `counts`, `commands`
and `throttle_q15` of the sample at its end. One run is a batch of one.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Protocol

import numpy as np
import numpy.typing as npt

from plumb.physics import pilots
from plumb.physics.airframe import G_MPS2, HUMMINGBIRD_X, Airframe, command_for
from plumb.physics.cascade import Cascade
from plumb.physics.ground import Ground
from plumb.physics.imu import Imu
from plumb.physics.quadrotor import Quadrotor
from plumb.physics.wind import Wind
from plumb.spec.arrays import BoolArray, FloatArray
from plumb.systems.quadrotor import courses

FRAME = HUMMINGBIRD_X
SUB_STEP_S, DELAY_STEPS = 0.00125, 2
"""Steps of the physics, and the delay of a command in them: 2 ms of the ESC and half a millisecond of computing."""
FULL_Q15 = 32767
STICK_LEAN_RAD, STICK_RATE_DPS, STICK_YAW_DPS = np.radians(35.0), 400.0, 180.0
"""What a pilot takes a full stick for."""
ROTORS_ON, MODE_RATE = 1, 2
FRAME_S, NUMBERS = 1.0 / 150.0, 255
"""The receiver hears 150 frames a second (CRSF), numbered 1 to 255 in a circle."""
TOUCHED_M = 0.01


class Drawn(Protocol):
    """The drawn values of a run: `plumb.systems.quadrotor.drawn_run.Scenario`."""

    @property
    def period_us(self) -> int: ...
    @property
    def course(self) -> courses.Course: ...
    @property
    def noise(self) -> FloatArray: ...
    @property
    def sticks(self) -> FloatArray: ...


DRAWS = ("imu", "heading_rad", "wind_rad", "phase_rad", "gusts")
"""Further values, by name."""


class Vehicles:
    """The bodies of runs of one course and period. ideal: a float cascade on the true attitude flies instead of the
    commands that `advance` is given."""

    def __init__(self, drawn: Sequence[Drawn], *, ideal: bool = False, frame: Airframe = FRAME) -> None:
        first, self.frame = drawn[0], frame
        self.course, self.period_s, self.runs = first.course, first.period_us * 1e-6, len(drawn)
        self._noise = np.stack([one.noise for one in drawn], -1)
        self._sticks = np.stack([one.sticks for one in drawn], -1)
        draws = {name: np.stack([getattr(one, name) for one in drawn], -1) for name in DRAWS}
        self._phase_rad, self.step = draws["phase_rad"], 0
        half = draws["heading_rad"] / 2.0
        heading = np.cos(half), np.sin(half)
        attitude = np.stack([heading[0], 0.0 * half, 0.0 * half, heading[1]])
        if self.course.on_its_back:  # rolled by half a turn
            attitude = np.stack([0.0 * half, *heading, 0.0 * half])
        height_m = self.frame.leg_down_m if self.course.lands else courses.HEIGHT_M
        self.begin_m = np.stack([0.0 * half, 0.0 * half, 0.0 * half + height_m])
        self.body = Quadrotor(self.frame, attitude, self.begin_m, self.course.vibration_g)
        self.body.thrust_factor = np.ones((4, self.runs))
        self._ground = Ground(self.frame)
        self._wind = Wind(self.course.wind_mps, draws["wind_rad"], draws["gusts"])
        self._gust = np.stack([np.cos(draws["wind_rad"]), np.sin(draws["wind_rad"]), 0.0 * half])
        self.imu = Imu(self.course.grade, draws["imu"], self.period_s)
        self._waiting = deque([np.zeros((4, self.runs))] * DELAY_STEPS, maxlen=DELAY_STEPS + 1)
        self._collective = pilots.Collective(self.frame, self.runs, self.period_s)
        self._seen: deque[tuple[FloatArray, FloatArray]] = deque(
            maxlen=max(round(pilots.SEEN_LATE_S / self.period_s), 1)
        )
        self._sum_ms = np.zeros((2, self.runs))
        self._felt = np.zeros((3, self.runs)), self.body.matrix[2].copy()
        self._heard_s = -1.0
        self._cascade = Cascade(self.frame, self.runs, self.period_s) if ideal else None
        self.landed = np.zeros(self.runs, np.bool_)
        self.lean_rad, self.yaw_radps, self.thrust_n = (
            np.zeros((2, self.runs)),
            np.zeros(self.runs),
            np.zeros(self.runs),
        )
        self.rate_dps: tuple[float, float, float] | None = None
        self._commands, self._throttle = np.zeros((self.runs, 6), np.int16), np.zeros(self.runs, np.int32)
        self._pilot()

    @property
    def time_s(self) -> float:
        return self.step * self.period_s

    def advance(self, command: FloatArray) -> None:
        """One period of the physics with the commands of the rotors, 0 to 1, (4, runs)."""
        given = self._ideal_command() if self._cascade is not None else command
        at_s, self.step = self.time_s, self.step + 1
        self._wind.advance(self._noise[self.step % len(self._noise), 6:], self.period_s)
        if at_s >= courses.REST_S - 1e-9 and not self.course.held:
            self._fly(at_s, given)
        self._pilot()

    def _fly(self, at_s: float, command: FloatArray) -> None:
        body, course = self.body, self.course
        if at_s < courses.REST_S + self.period_s / 2.0 and not course.lands:
            body.spin_up(self.frame.hover_radps, self._phase_rad)
            hover = np.full(
                (4, self.runs),
                float(command_for(np.array(self.frame.weight_n / self.frame.thrust_max_n / course.supply))),
            )
            self._waiting.extend([hover] * DELAY_STEPS)
            command = hover
        wind_mps = self.wind_mps(at_s)
        if at_s >= course.happens_s:
            body.thrust_factor[0] = courses.WEAK_SHARE if course.weak else 1.0
            if at_s < course.happens_s + 0.01 - 1e-9:
                body.rate_radps[0] += course.kick_radps * self.period_s / 0.01
        steps = round(self.period_s / SUB_STEP_S)
        force, rate = np.zeros((3, self.runs)), np.zeros((3, self.runs))
        for _ in range(steps):
            self._waiting.append(command)
            target = body.target_radps(self._waiting[0], course.supply)
            force += body.advance(target, wind_mps, SUB_STEP_S, self._ground if course.lands else None)
            rate += body.rate_radps
        self._felt = np.degrees(rate) / steps, force / (G_MPS2 * steps)

    def wind_mps(self, at_s: float | None = None) -> FloatArray:
        """Wind at a time, None: now, earth axes, (3, runs)."""
        happened = (self.time_s if at_s is None else at_s) >= self.course.happens_s
        wind_mps = self._wind.velocity_mps()
        return wind_mps + self.course.gust_mps * self._gust if happened else wind_mps

    def counts(self) -> npt.NDArray[np.int16]:
        """Raw counts of gyro and accelerometer now, (runs, 6)."""
        return self.imu.counts(self.time_s, *self._felt, self._noise[self.step % len(self._noise), :6])

    def commands(self) -> npt.NDArray[np.int16]:
        """Words of the commands, (runs, 6): what the receiver has heard last."""
        return self._commands

    def throttle_q15(self) -> npt.NDArray[np.int32]:
        """The throttle that the receiver has heard last, (runs,)."""
        return self._throttle

    def _pilot(self) -> None:
        """What the pilot asks for now; the receiver hears it with its next frame."""
        body, now_s = self.body, self.time_s
        self._seen.append((body.position_m.copy(), body.velocity_mps.copy()))
        position, velocity = self._seen[0]
        position = position - self.begin_m
        flying = now_s >= courses.REST_S
        if flying:
            self._sum_ms = np.clip(self._sum_ms + self.period_s * position[:2], -30.0, 30.0)
        nose = body.matrix[:2, 0]
        heading = nose / np.maximum(np.sqrt((nose * nose).sum(axis=0)), 1e-6)
        acts_s = now_s - courses.ACTS_S
        knows = pilots.Seen(max(acts_s, 0.0), position, velocity, heading, self._sticks, self._sum_ms)
        roll, pitch, self.yaw_radps = (pilots.centred if acts_s < 0.0 else self.course.pilot)(knows)
        self.lean_rad = np.stack([roll, pitch])
        if flying and not self.course.held:
            self.thrust_n = self._collective.thrust_n(body, *self._height(now_s))
        self.rate_dps = next((one.rate_dps for one in self.course.turns if one.begin_s <= now_s < one.end_s), None)
        if self.course.lands and now_s > self.course.land_at_s:
            self.landed |= self._ground.touched(body.position_m, TOUCHED_M)
        frame = int(now_s / FRAME_S + 1e-6)
        begin_s, end_s = self.course.lost_s
        if frame * FRAME_S > self._heard_s and not begin_s <= now_s < end_s:
            self._heard_s = frame * FRAME_S
            self._hear(frame % NUMBERS + 1, flying)

    def _height(self, now_s: float) -> tuple[FloatArray, float]:
        begin_m = self.begin_m[2]
        if not self.course.lands:
            return begin_m, 0.0
        since_s = now_s - courses.REST_S
        if now_s < self.course.land_at_s:
            rising = since_s * courses.CLIMB_MPS < self.course.climb_m
            return begin_m + min(since_s * courses.CLIMB_MPS, self.course.climb_m), courses.CLIMB_MPS if rising else 0.0
        return begin_m + self.course.climb_m - courses.SINK_MPS * (now_s - self.course.land_at_s), -courses.SINK_MPS

    def _hear(self, number: int, flying: bool) -> None:
        roll, pitch = self.lean_rad
        full = np.sin(STICK_LEAN_RAD)
        sticks = [np.sin(roll) * np.cos(pitch) / full, np.sin(pitch) / full, np.degrees(self.yaw_radps) / STICK_YAW_DPS]
        switches = (ROTORS_ON if flying else 0) * ~self.landed
        if self.rate_dps is not None:
            x, y, z = self.rate_dps
            shape = np.ones(self.runs)
            sticks = [x / STICK_RATE_DPS * shape, y / STICK_RATE_DPS * shape, z / STICK_YAW_DPS * shape]
            switches = switches | MODE_RATE
        words = [np.rint(np.clip(one, -1.0, 1.0) * FULL_Q15) for one in sticks]
        zero = np.zeros(self.runs)
        self._commands = np.stack([*words, switches + zero, zero + number, zero], 1).astype(np.int16)
        share = command_for(self.thrust_n / (self.frame.thrust_max_n * self.course.supply)) if flying else zero
        self._throttle = np.where(
            self.landed | (self.time_s >= self.course.cut_s), 0, np.rint(share * FULL_Q15)
        ).astype(np.int32)

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
