"""What `balancer` was asked to reach, and what the integers reach (see plumb.systems.figures).

Open loop: the ride of the ideal controller. Closed loop: the C integers in the loop, judged on the true tilt.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from plumb import metrics, native, quantise, reference
from plumb.systems import balancer, balancer_plant
from plumb.systems.balancer_plant import BalancerPlant
from plumb.systems.figures import Figure
from plumb.tuning import BalancerTuning

FloatArray = npt.NDArray[np.float64]

TURN_DEG, RATE_DPS = 360.0 / 2.0**32, 360.0 / 2.0**28
ASSUMED = (
    "Scores t >= 10 s; tunings fitted on seeds 0-19. Accelerometer only is atan2 of the two axes, nothing taken off.",
    f"Vibration white, 0.1 g (rough) or 0.02 g (smooth); bias +-{balancer.BIAS_DPS:g}, warm-up {balancer.DRIFT_DPS:g}"
    f" deg/s in {balancer.DRIFT_TAU_S:g} s, walk {balancer.WALK_DPS_PER_RTS} deg/s/sqrt(s), scale"
    f" {100 * balancer.SCALE_ERROR:g} %, {balancer.DPS_PER_G} deg/s/g, offset {1e3 * balancer.OFFSET_G:g} mg.",
    f"Per 120 s {balancer.COMMANDS} commands to +-{balancer.COMMAND_MPS} m/s and {balancer.PUSHES} pushes of"
    f" {balancer.PUSH_S} s to +-{balancer.PUSH_MPS2:g} m/s^2; disturbance"
    f" {balancer_plant.DISTURBANCE_RADPS2_PER_RTS} rad/s^2/sqrt(s) through {balancer_plant.DISTURBANCE_TAU_S} s.",
    f"Assumed: body {balancer_plant.BODY_KG} kg, wheels {balancer_plant.WHEELS_KG} kg of radius"
    f" {balancer_plant.WHEEL_RADIUS_M} m, {balancer_plant.EDGES_PER_TURN} Hall edges per turn, stall torque"
    f" {balancer_plant.STALL_NM} Nm, no-load speed {balancer_plant.NO_LOAD_RADPS:g} rad/s, friction"
    f" {balancer_plant.FRICTION_NM} Nm.",
    "'tuned' and 'paper_rule_wheel' take the axle's acceleration, from the Hall sensors, off the forward axis.",
)


@dataclass(frozen=True)
class Batch:
    """One scenario's prescribed rides: raw (steps, 6, runs), setpoint, tilt and rate (steps, runs)."""

    name: str
    raw: npt.NDArray[np.int16]
    setpoint: npt.NDArray[np.int32]
    tilt_deg: FloatArray
    rate_dps: FloatArray
    scored: npt.NDArray[np.bool_]

    @classmethod
    def of(cls, name: str, seeds: Iterable[int]) -> Batch:
        runs = [balancer.scenario(name, seed) for seed in seeds]
        return cls(
            name,
            np.stack([run.counts() for run in runs], axis=-1),
            np.stack([run.setpoint() for run in runs], axis=-1),
            np.stack([run.ride.tilt_deg for run in runs], axis=-1),
            np.stack([run.ride.rate_dps for run in runs], axis=-1),
            runs[0].scored,
        )

    def tilt_rms(self, tilt_deg: FloatArray) -> FloatArray:
        """Of every run, (runs,)."""
        return metrics.angle_rmse_deg(tilt_deg, self.tilt_deg, self.scored)

    def rate_rms(self, rate_dps: FloatArray) -> FloatArray:
        """Of every run, (runs,)."""
        return np.asarray(np.sqrt(np.mean((rate_dps - self.rate_dps)[self.scored] ** 2, axis=0)), np.float64)

    def gyro_dps(self) -> FloatArray:
        return np.asarray(self.raw[:, 0] * balancer.CALIBRATION.gyro.unit_per_count, np.float64)

    def accel_only_deg(self) -> FloatArray:
        return metrics.accel_only_deg(-self.raw[:, 1].astype(np.float64), self.raw[:, 2].astype(np.float64))

    def gyro_only_deg(self) -> FloatArray:
        return metrics.gyro_only_deg(self.gyro_dps(), balancer.PERIOD_US * 1e-6, self.tilt_deg[:1])


def open_rows(seeds: Iterable[int]) -> Iterator[Figure]:
    """Prescribed rides: accelerometer alone, then every tuning on tilt and on the corrected rate."""
    limits: tuple[tuple[str, float, float], ...] = (("rough", 5.84, 0.48), ("smooth", 1.54, 0.40))
    for name, alone_deg, reach_deg in limits:
        batch = Batch.of(name, seeds)
        alone = batch.tilt_rms(batch.accel_only_deg())
        yield Figure(
            "accelerometer only (the scenario's own figure)", name, "-", "deg rms", "near", alone_deg,
            float(np.mean(alone)), float(np.max(alone)),
        )  # fmt: skip
        yield from _estimate(batch, "tuned", "tilt error", reach_deg)
        yield from _estimate(batch, "arctan", "tilt error, nothing taken off", reach_deg)
        yield from _estimate(batch, "paper_rule", "tilt error, paper's rule Q_bias = Q_angle / 1000", reach_deg)
        yield from _estimate(batch, "paper_rule_wheel", "tilt error, paper's rule, wheel", reach_deg)


def _estimate(batch: Batch, tuning: str, claim: str, reach_deg: float) -> Iterator[Figure]:
    settings = balancer.TUNINGS[tuning]
    words = native.run_control(quantise.quantise(settings), batch.raw, batch.setpoint)
    ideal = reference.run_control(settings, batch.raw, batch.setpoint)
    tilt = batch.tilt_rms(np.asarray(words["tilt_turn_q32"] * TURN_DEG))
    rate = batch.rate_rms(np.asarray(words["rate_corrected_turnps_q28"] * RATE_DPS))
    accel, gyro = batch.tilt_rms(batch.accel_only_deg()), batch.tilt_rms(batch.gyro_only_deg())
    yield Figure(
        claim, batch.name, tuning, "deg rms", "at most", reach_deg, float(np.mean(tilt)), float(np.max(tilt)),
        float(np.mean(batch.tilt_rms(ideal["tilt_deg"]))), float(np.mean(accel)), float(np.mean(gyro)),
    )  # fmt: skip
    yield Figure(
        "corrected rate", batch.name, tuning, "deg/s rms", "at most", 0.42, float(np.mean(rate)), float(np.max(rate)),
        float(np.mean(batch.rate_rms(ideal["rate_corrected_dps"]))), None,
        float(np.mean(batch.rate_rms(batch.gyro_dps()))),
    )  # fmt: skip


def closed_rows(seeds: Iterable[int]) -> Iterator[Figure]:
    """The loop closed on the estimate: its error, and that the vehicle never falls; ten minutes of it as well."""
    cases: tuple[tuple[str, str, float], ...] = (
        ("closed loop, tilt error", "rough", 0.55),
        ("closed loop, tilt error", "smooth", 0.48),
        ("ten minutes, tilt error", "endure", 0.55),
    )
    for claim, name, reach_deg in cases:
        runs = [balance(balancer.TUNED, name, seed) for seed in seeds]
        error = [run.error_rms_deg for run in runs]
        yield Figure(
            claim, name, "tuned", "deg rms", "at most", reach_deg, float(np.mean(error)), max(error)
        )  # fmt: skip
        leaned = [run.tilt_max_deg for run in runs]
        claim = "stays up: largest tilt of any run"
        yield Figure(claim, name, "tuned", "deg", "at most", 20.0, max(leaned), max(leaned))


@dataclass(frozen=True)
class Balanced:
    """One closed loop: error of the estimate over the scored samples, largest true tilt, velocity error."""

    error_rms_deg: float
    tilt_max_deg: float
    velocity_rms_mps: float


def balance(tuning: BalancerTuning, name: str, seed: int, seconds: float | None = None) -> Balanced:
    """One closed loop on the native core: the plant's counts in, the duty of the same step out."""
    scenario = balancer.scenario(name, seed, seconds=seconds, period_us=tuning.period_us)
    plant, controller = BalancerPlant(scenario), native.Controller(quantise.quantise(tuning))
    setpoint, outputs = scenario.setpoint().tolist(), dict[str, int]()
    rows = np.empty((scenario.steps, 3))
    for k, time_s in enumerate(scenario.time_s.tolist()):
        plant.follow(time_s, outputs)
        words = controller.step(plant.counts(time_s), setpoint[k])
        outputs = {"duty_q15": words["duty_q15"]}
        true = plant.truth(time_s)
        rows[k] = true["tilt_deg"], words["tilt_turn_q32"] * TURN_DEG, true["velocity_mps"]
    scored = scenario.scored
    apart = metrics.wrap_deg(rows[:, 1] - rows[:, 0])[scored]
    slip = (rows[:, 2] - np.array(setpoint) / balancer.VELOCITY_UNIT)[scored]
    return Balanced(
        float(np.sqrt(np.mean(apart**2))), float(np.max(np.abs(rows[:, 0]))), float(np.sqrt(np.mean(slip**2)))
    )


SECTIONS: dict[str, Callable[[Iterable[int]], Iterator[Figure]]] = {"open loop": open_rows, "closed loop": closed_rows}
