"""The ride of `balancer` written down a second time, from its definition alone, with draws of its own: the tilt errors
of the shipped filters are the same within what so few runs scatter. No scenario, plant or sensor of plumb takes part.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from plumb.boards.native import core as native_core
from plumb.contract.parameters import quantise
from plumb.judging.balancer.plots import TURN_DEG
from plumb.judging.balancer.rides import Batch
from plumb.proof import figures
from plumb.spec.arrays import FloatArray
from plumb.spec.tuning import Trust
from plumb.systems.balancer import scenarios as balancer

RUNS, SCORED_FROM = 100, 1000
GRAVITY, PENDULUM_M, SENSOR_M = 9.80665, 0.15, 0.10
EDGE_M = 2.0 * math.pi * 0.05 / 84


def outside(rng: np.random.Generator, t: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Velocity setpoints in m/s and pushes in m/s^2, (1 ms, runs)."""
    wanted, pushed = np.zeros((len(t), RUNS)), np.zeros((len(t), RUNS))
    for run in range(RUNS):
        speeds = rng.uniform(-0.6, 0.6, 14)
        speeds[3::4] = 0.0
        for begins_s, speed in zip(np.sort(rng.uniform(8.0, 112.0, 14)), speeds, strict=True):
            wanted[t >= begins_s, run] = speed
        for begins_s, size in zip(rng.uniform(10.0, 115.0, 8), rng.uniform(-6.0, 6.0, 8), strict=True):
            pushed[(t >= begins_s) & (t < begins_s + 0.15), run] += size
    return wanted, pushed


def ridden(vibration_g: float) -> tuple[npt.NDArray[np.int16], FloatArray]:
    """Counts (steps, 6, runs), and the true tilt in deg, (steps, runs)."""
    rng, t = np.random.default_rng(20260101), np.arange(120_000, dtype=np.float64) * 1e-3
    wanted, pushed = outside(rng, t)
    tilt, rate, speed, way, swing, accel, turning = np.zeros((7, RUNS))
    raw, truth = np.zeros((len(t) // 10, 6, RUNS), np.int16), np.zeros((len(t) // 10, RUNS))
    scale, offset_g = 1.0 + 0.01 * rng.standard_normal(RUNS), 0.002 * rng.standard_normal((2, RUNS))
    bias, drift, walk = rng.uniform(-3.0, 3.0, RUNS), rng.choice([-1.0, 1.0], RUNS), np.zeros(RUNS)
    for k, now in enumerate(t.tolist()):
        if k % 10 == 0:
            sine, cosine = np.sin(tilt), np.cos(tilt)
            along = accel + SENSOR_M * (turning * cosine - rate**2 * sine)
            up = GRAVITY - SENSOR_M * (turning * sine + rate**2 * cosine)
            force = np.stack([along * cosine - up * sine, along * sine + up * cosine]) / GRAVITY
            force += vibration_g * rng.standard_normal((2, RUNS)) * (now >= 3.0)
            walk += 0.003 * math.sqrt(0.01) * rng.standard_normal(RUNS)
            gyro = scale * np.degrees(rate) + bias + drift * (1.0 - math.exp(-now / 60.0)) + walk
            gyro += 0.1 * force[0] + 0.38 * rng.standard_normal(RUNS)
            noise = np.array([[0.75], [1.1]]) * rng.standard_normal((2, RUNS))
            raw[k // 10, 0], raw[k // 10, 1:3] = np.rint(14.375 * gyro), np.rint(256.0 * (force + offset_g) + noise)
            raw[k // 10, 3] = np.floor((way - 0.05 * tilt) / EDGE_M)
            truth[k // 10] = np.degrees(tilt)
        if now >= 3.0:
            swing += -swing * 1e-3 / 0.3 + 0.8 * math.sqrt(1e-3) * rng.standard_normal(RUNS) * (now >= 5.0)
            accel = np.clip(60.0 * tilt + 12.0 * rate + 6.0 * (speed - wanted[k]), -8.0, 8.0)
            turning = (GRAVITY * np.sin(tilt) - accel * np.cos(tilt) + 0.3 * pushed[k]) / PENDULUM_M + swing
            rate, speed = rate + 1e-3 * turning, speed + 1e-3 * accel
            tilt, way = tilt + 1e-3 * rate, way + 1e-3 * speed
    return raw, truth


@pytest.mark.long
@pytest.mark.parametrize("scenario", ["rough", "smooth"])
def test_a_ride_written_again_has_the_same_errors(scenario: str) -> None:
    raw, truth = ridden(balancer.VIBRATION_G[scenario])
    shipped = Batch.of(scenario, figures.SEEDS)
    for name, tuning in balancer.TUNINGS.items():
        words = quantise(tuning)
        error = native_core.run_control(words, raw, np.zeros(truth.shape, np.int32))["tilt_turn_q32"] * TURN_DEG - truth
        again = np.sqrt(np.mean(error[SCORED_FROM:] ** 2, axis=0))
        there = shipped.tilt_rms(
            np.asarray(native_core.run_control(words, shipped.raw, shipped.setpoint)["tilt_turn_q32"] * TURN_DEG)
        )
        scatter = math.hypot(np.std(again) / math.sqrt(RUNS), np.std(there) / math.sqrt(len(there)))
        print(f"{scenario} {name}: {np.mean(again):.3f} +- {np.std(again) / 10:.3f}, shipped {np.mean(there):.3f}")
        assert abs(np.mean(again) - np.mean(there)) < 3.0 * scatter, name


@pytest.mark.long
def test_the_row_of_the_papers_rule_depends_on_the_r_that_it_leaves_open() -> None:
    """0.48 deg with the variance of the vibration alone. 0.52, which another reading of the source gave, needs no other
    scenario, but another R."""
    shipped = Batch.of("rough", figures.SEEDS)
    tuning = balancer.TUNINGS["paper_rule_wheel"]

    def run(r_deg2: float) -> dict[str, FloatArray]:
        words = native_core.run_control(
            quantise(replace(tuning, trust=Trust(r_deg2=r_deg2))), shipped.raw, shipped.setpoint
        )
        return {name: np.asarray(words[f"{name}_turn_q32"] * TURN_DEG) for name in ("tilt", "tilt_measured")}

    rides = {r_deg2: run(r_deg2) for r_deg2 in (33.0, 51.0, 58.0)}
    assert tuning.trust.r_deg2 == 33.0
    measured = shipped.tilt_rms(rides[33.0]["tilt_measured"]) ** 2
    assert round(float(np.mean(measured))) == 51
    rounded = {r_deg2: f"{np.mean(shipped.tilt_rms(ride['tilt'])):.2f}" for r_deg2, ride in rides.items()}
    assert rounded == {33.0: "0.48", 51.0: "0.50", 58.0: "0.52"}
