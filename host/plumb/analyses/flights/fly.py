"""Fly one flight: all seeds and all estimators side by side, a step of all of them at a time.

The same seed is the same flight for every estimator: sensors, noise, gusts, sticks. A run that leans by more than 85
deg, or that meets the ground where it should not, has crashed: it is scored no more, and put back to where it began so
that its numbers stay finite.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from plumb.analyses.flights.estimators import Estimator, Flown
from plumb.analyses.flights.flights import (
    CLIMB_M,
    CLIMB_MPS,
    CRASH_TILT_RAD,
    HEIGHT_M,
    LAND_AT_S,
    REST_S,
    SETTLED_S,
    SINK_MPS,
    Flight,
)
from plumb.physics import pilots
from plumb.physics.airframe import G_MPS2, command_for
from plumb.physics.cascade import Cascade
from plumb.physics.ground import Ground
from plumb.physics.imu import DRAWS, Imu
from plumb.physics.quadrotor import Quadrotor
from plumb.physics.wind import Wind
from plumb.spec.arrays import BoolArray, FloatArray

SUB_STEP_S, DELAY_STEPS = 0.00125, 2
"""Steps of the physics, and the delay of a command in them: 2 ms of the ESC and half a millisecond of computing."""
CHUNK, NOISES, STICKS = 400, 9, 1200
RECORD_S = 0.01
"""Between two errors that are kept."""


@dataclass(frozen=True)
class Flew:
    """An estimator's flights. errors_deg, sigma_deg: (times, runs), NaN where nothing is scored; crashed: (runs,)."""

    estimator: str
    time_s: FloatArray
    errors_deg: FloatArray
    sigma_deg: FloatArray | None
    crashed: BoolArray
    restarts: int


class _Draws:
    """The numbers that the seeds draw, and the noise of each step; those of a seed do not depend on the other seeds."""

    def __init__(self, seeds: Sequence[int]) -> None:
        self._each = [np.random.default_rng(seed) for seed in seeds]
        self.imu = self._drawn(lambda one: one.standard_normal(DRAWS))
        self.heading_rad, self.wind_rad = self._drawn(lambda one: one.uniform(0.0, 2.0 * np.pi, 2))
        self.phase_rad = self._drawn(lambda one: one.uniform(0.0, 2.0 * np.pi, 4))
        self.gusts = self._drawn(lambda one: one.standard_normal(5))
        self.sticks = np.moveaxis(np.array([one.uniform(-1.0, 1.0, (STICKS, 2)) for one in self._each]), 0, -1)

    def _drawn(self, draw: Callable[[np.random.Generator], FloatArray]) -> FloatArray:
        return np.array([draw(one) for one in self._each]).T

    def noise(self) -> Iterator[FloatArray]:
        """(NOISES, seeds) for every step."""
        while True:
            yield from np.moveaxis(np.array([one.standard_normal((CHUNK, NOISES)) for one in self._each]), 0, -1)


def _start(flight: Flight, heading_rad: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Attitudes and positions at the beginning."""
    attitude, position = Ground(flight.frame, flight.slope_rad).standing(heading_rad)
    if not flight.lands:
        position = np.broadcast_to(np.array([0.0, 0.0, HEIGHT_M])[:, None], position.shape).copy()
    return attitude, position


class _Loop:
    """State of a flight between two steps."""

    def __init__(self, flight: Flight, seeds: Sequence[int], estimators: Sequence[Estimator]) -> None:
        self.flight, self.draws, self.copies = flight, _Draws(seeds), len(estimators)
        runs, frame, period_s = len(seeds) * self.copies, flight.frame, flight.period_us * 1e-6
        self.period_s, self.runs = period_s, runs
        self.heading_rad = self._all(self.draws.heading_rad)
        self.begin = _start(flight, self.heading_rad)
        self.body = Quadrotor(frame, *self.begin, flight.vibration_g)
        self.body.spin_up(0.0, self._all(self.draws.phase_rad))
        self.ground = Ground(frame, flight.slope_rad) if flight.lands else None
        self.wind = Wind(flight.wind_mps, self._all(self.draws.wind_rad), self._all(self.draws.gusts))
        self.imu = Imu(flight.grade, self._all(self.draws.imu), period_s)
        self.cascade = Cascade(frame, runs, period_s)
        self.collective = pilots.Collective(frame, runs, period_s)
        self.flown: list[Flown] = [one.begin(flight.grade, frame, flight.period_us, len(seeds)) for one in estimators]
        self.sticks, self.sum_ms = self._all(self.draws.sticks), np.zeros((2, runs))
        late = max(round(pilots.SEEN_LATE_S / period_s), 1)
        self.seen: deque[tuple[FloatArray, FloatArray]] = deque(maxlen=late)
        self.waiting = deque([np.zeros((4, runs))] * DELAY_STEPS, maxlen=DELAY_STEPS + 1)
        self.command = np.zeros((4, runs))
        self.landed, self.crashed = np.zeros(runs, np.bool_), np.zeros(runs, np.bool_)

    def _all(self, of_seeds: FloatArray) -> FloatArray:
        """The same for every estimator: runs of the first one, then of the next."""
        return np.concatenate([of_seeds] * self.copies, axis=-1)

    def felt(self, time_s: float) -> tuple[FloatArray, FloatArray]:
        """Physics of one period: mean rate in deg/s and mean specific force in g."""
        body, flight = self.body, self.flight
        if time_s < REST_S:
            return np.zeros((3, self.runs)), body.matrix[2].copy()
        steps, wind_mps = round(self.period_s / SUB_STEP_S), self.wind.velocity_mps()
        supply = 1.0 - flight.supply_lost * time_s / 600.0
        force, rate, target = np.zeros((3, self.runs)), np.zeros((3, self.runs)), self.body.target_radps(self.command)
        for _ in range(steps):
            self.waiting.append(self.command)
            target = body.target_radps(self.waiting[0], supply)
            force += body.advance(target, wind_mps, SUB_STEP_S, self.ground)
            rate += body.rate_radps
        return np.degrees(rate) / steps, force / (G_MPS2 * steps)

    def estimate(self, counts: np.ndarray[tuple[int, ...], np.dtype[np.int16]]) -> FloatArray:
        """Verticals in body axes, (3, runs)."""
        each = self.runs // self.copies
        thrust = self.command.mean(axis=0)
        parts = [slice(at * each, (at + 1) * each) for at in range(self.copies)]
        ups = [one.step(counts[part], thrust[part]) for one, part in zip(self.flown, parts, strict=True)]
        return np.ascontiguousarray(np.concatenate(ups).T)

    def control(self, time_s: float, up: FloatArray, rate_radps: FloatArray) -> None:
        """New commands of the rotors."""
        body, flight = self.body, self.flight
        self.seen.append((body.position_m.copy(), body.velocity_mps.copy()))
        position, velocity = self.seen[0]
        position = position - self.begin[1]
        self.sum_ms = np.clip(self.sum_ms + self.period_s * position[:2], -30.0, 30.0)
        nose = body.matrix[:2, 0]
        heading = nose / np.maximum(np.sqrt((nose * nose).sum(axis=0)), 1e-6)
        acts_s = time_s - REST_S - SETTLED_S
        knows = pilots.Seen(max(acts_s, 0.0), position, velocity, heading, self.sticks, self.sum_ms)
        roll, pitch, yaw_radps = (pilots.centred if acts_s < 0.0 else flight.pilot)(knows)
        height_m, climb_mps = self._height(time_s)
        thrust_n = self.collective.thrust_n(body, height_m, climb_mps)
        if self.ground is not None:
            thrust_n = thrust_n * min((time_s - REST_S) / 0.3, 1.0)
            if time_s > LAND_AT_S:
                self.landed |= self.ground.touched(body.position_m, 0.01)
        command = self.cascade.command(up, pilots.vertical(roll, pitch), yaw_radps, rate_radps, thrust_n, ~self.landed)
        self.command = np.where(self.landed, 0.0, command)

    def _height(self, time_s: float) -> tuple[FloatArray, float]:
        begin_m = self.begin[1][2]
        if not self.flight.lands:
            return begin_m, 0.0
        since_s = time_s - REST_S
        if time_s < LAND_AT_S:
            rising = since_s * CLIMB_MPS < CLIMB_M
            return begin_m + min(since_s * CLIMB_MPS, CLIMB_M), CLIMB_MPS if rising else 0.0
        return begin_m + CLIMB_M - SINK_MPS * (time_s - LAND_AT_S), -SINK_MPS

    def judge(self) -> None:
        """Notes the runs that have crashed, and puts them back."""
        body = self.body
        low = body.position_m[2] < 0.0 if self.ground is None else np.zeros(self.runs, np.bool_)
        lost = (body.matrix[2, 2] < np.cos(CRASH_TILT_RAD)) | low
        if not lost.any():
            return
        self.crashed |= lost
        attitude, position = self.begin
        body.attitude[:, lost], body.position_m[:, lost] = attitude[:, lost], position[:, lost]
        body.velocity_mps[:, lost], body.rate_radps[:, lost] = 0.0, 0.0
        body.matrix[2, 2, lost] = 1.0


def fly(
    flight: Flight,
    seeds: Sequence[int],
    estimators: Sequence[Estimator],
    done: Callable[[float], object] = lambda _: None,
) -> list[Flew]:
    """All seeds on every estimator. done: called with the seconds that were flown since the last call."""
    loop = _Loop(flight, seeds, estimators)
    steps, every = round(flight.seconds / loop.period_s), max(round(RECORD_S / loop.period_s), 1)
    kept, sigmas, noise = [], [], loop.draws.noise()
    hover_radps, body = flight.frame.hover_radps, loop.body
    for step in range(steps):
        time_s = step * loop.period_s
        white = loop._all(next(noise))
        if time_s >= REST_S and time_s - loop.period_s < REST_S and not flight.lands:
            body.spin_up(hover_radps, loop._all(loop.draws.phase_rad))
            hover = np.full((4, loop.runs), float(_hover_command(flight)))
            loop.command, loop.waiting = hover, deque([hover] * DELAY_STEPS, maxlen=DELAY_STEPS + 1)
        rate_dps, force_g = loop.felt(time_s)
        loop.wind.advance(white[6:], loop.period_s)
        counts = loop.imu.counts(time_s, rate_dps, force_g, white[:6])
        up = loop.estimate(counts)
        if time_s >= REST_S:
            measured = np.radians(counts[:, :3].T * flight.grade.gyro.unit_per_count)
            loop.control(time_s, up, measured)
            loop.judge()
        if step % every == every - 1:
            scored = (time_s >= flight.scored_from_s) & ~loop.crashed
            kept.append(np.where(scored, _apart_deg(up, body.matrix[2]), np.nan))
            sigmas.append([one.sigma_deg() for one in loop.flown])
            done(every * loop.period_s)
    return _parted(loop, estimators, np.stack(kept).astype(np.float64), sigmas, every)


def _hover_command(flight: Flight) -> FloatArray:
    return command_for(np.array(flight.frame.weight_n / flight.frame.thrust_max_n))


def _apart_deg(a: FloatArray, b: FloatArray) -> FloatArray:
    """Angle between unit vectors (3, runs)."""
    across = a - b
    return np.asarray(np.degrees(2.0 * np.arcsin(np.minimum(np.sqrt((across * across).sum(axis=0)) / 2.0, 1.0))))


def _parted(
    loop: _Loop, estimators: Sequence[Estimator], errors: FloatArray, sigmas: list[list[FloatArray | None]], every: int
) -> list[Flew]:
    each, found = loop.runs // loop.copies, []
    time_s = np.asarray((np.arange(len(errors)) + 1) * every * loop.period_s, np.float64)
    for at, (estimator, flown) in enumerate(zip(estimators, loop.flown, strict=True)):
        part = slice(at * each, (at + 1) * each)
        own = [row[at] for row in sigmas]
        stated = np.array([one for one in own if one is not None])
        found.append(
            Flew(
                estimator.name, time_s, errors[:, part], stated if len(stated) else None, loop.crashed[part],
                flown.restarts(),
            )
        )  # fmt: skip
    return found
