"""Targets of `balancer` and the figures that the integers reach (see plumb.proof.figures).

Open loop: the motion of the ideal controller. Closed loop: the C integers in the loop, scored against the true tilt.
The source's own filter, the arctangent of the two axes without compensation, is listed with the shipped tuning for
comparison; it has no target.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping

import numpy as np

from plumb.boards.native import core as native_core
from plumb.contract import run_reference
from plumb.contract.parameters import quantise
from plumb.judging.balancer import loops
from plumb.judging.balancer.closed_loops import SETTLED_S, Balanced, Float64, balance, balanced
from plumb.judging.balancer.paper_plots import PLOTS as PLOTS
from plumb.judging.balancer.plots import RATE_DPS, TURN_DEG
from plumb.judging.balancer.rides import Batch
from plumb.kernels.reference.blending import complementary_step
from plumb.proof import loop_figures, metrics
from plumb.proof.figures import FLOAT_SEEDS, UNASKED, Figure, Sense, paired
from plumb.proof.limits import Limit, Limits
from plumb.proof.loop_figures import LeastMargins
from plumb.spec.arrays import FloatArray
from plumb.systems import scoring
from plumb.systems.balancer import scenarios as balancer
from plumb.systems.balancer import vehicle
from plumb.systems.balancer.drawn_run import DPS_PER_G, GYRO

HEADLINE = ("tilt error", "rough", "tuned")
RAW_DPS = 1.7
"""Error of the raw rate that the scenario specifies, deg/s rms."""


def expected_raw_dps() -> tuple[float, float]:
    """Expected error of the raw rate due to bias, noise and rounding: mean and standard deviation over runs of the rms
    over the scored samples, deg/s.

    The initial bias is uniform. The sign of the warm-up drift is random, so that both signs have the same rms. Random
    walk and noise add as squares.
    """
    time_s = np.arange(0.0, balancer.SECONDS["rough"], balancer.PERIOD_US * 1e-6)
    time_s = time_s[scoring.scored(time_s)]
    warm = balancer.DRIFT_DPS * (1.0 - np.exp(-time_s / balancer.DRIFT_TAU_S))
    start = np.linspace(-balancer.BIAS_DPS, balancer.BIAS_DPS, 2001)
    bias = start**2 + 2.0 * start * np.mean(warm) + np.mean(warm**2)
    walk = balancer.WALK_DPS_PER_RTS**2 * np.mean(time_s)
    rounding = 1.0 / (12.0 * GYRO.lsb_per_dps**2)
    run = np.sqrt(bias + walk + balancer.GYRO_NOISE_DPS**2 + rounding)
    return float(np.mean(run)), float(np.std(run))


ASSUMED = (
    "Scores t >= 10 s; tunings fitted on seeds 0-159. Accelerometer only is atan2 of the two axes, nothing taken off.",
    f"Vibration white, 0.1 g (rough, endure) or 0.02 g (smooth); bias +-{balancer.BIAS_DPS:g}, warm-up"
    f" {balancer.DRIFT_DPS:g} deg/s in {balancer.DRIFT_TAU_S:g} s, walk {balancer.WALK_DPS_PER_RTS} deg/s/sqrt(s),"
    f" scale {100 * balancer.SCALE_ERROR:g} %, {DPS_PER_G} deg/s/g, offset {1e3 * balancer.OFFSET_G:g} mg.",
    f"Per 120 s {balancer.COMMANDS} commands to +-{balancer.COMMAND_MPS} m/s and {balancer.PUSHES} pushes of"
    f" {balancer.PUSH_S} s to +-{balancer.PUSH_MPS2:g} m/s^2; disturbance"
    f" {vehicle.DISTURBANCE_RADPS2_PER_RTS} rad/s^2/sqrt(s) through {vehicle.DISTURBANCE_TAU_S} s.",
    f"Assumed: body {vehicle.BODY_KG} kg, wheels {vehicle.WHEELS_KG} kg of radius"
    f" {vehicle.WHEEL_RADIUS_M} m, {vehicle.EDGES_PER_TURN} Hall edges per turn, stall torque"
    f" {vehicle.STALL_NM} Nm, no-load speed {vehicle.NO_LOAD_RADPS:g} rad/s, friction"
    f" {vehicle.FRICTION_NM} Nm.",
    "'tuned' and 'paper_rule_wheel' take the axle's acceleration, from the Hall sensors, off the forward axis; the"
    " others do not, as the source does not. Gyro only: bias taken from the first 3 s.",
    f"Raw rate: the start bias decides, {expected_raw_dps()[0]:.2f} deg/s over all that can be drawn; the mean of 40"
    f" runs scatters by {expected_raw_dps()[1] / np.sqrt(40.0):.2f} about it (one standard deviation).",
    "Complementary filter, which the firmware does not have: float64, its time constant fitted on seeds 0-19 of the"
    " scenario; bias from the first 3 s, the axle's acceleration taken off the tilt.",
    f"rocked: held by hand, {balancer.VIBRATION_G['rocked']:g} g of vibration, which makes the source's +-10 deg.",
    "Margins: about upright, the wheels rolling; balance broken at the command of the bridge, the speed loop closed;"
    " speed at the lean that it asks for. The source has no targets for them.",
)


OPEN_RMS_DEG = {"rough": 0.48, "smooth": 0.40}
CLOSED_RMS_DEG = {"rough": 0.55, "smooth": 0.48, "endure": 0.55}
LEAST_MARGINS = {"balance": LeastMargins(45.0, 6.0, 0.005), "speed": LeastMargins(45.0, 6.0, 0.5)}
"""The source has no targets for them. Phase: 45 deg. Gain of the balance loop: 5 dB, a factor of 1.78, for a full
battery (8.4 V on one of 7.4 V), a motor of a quarter more torque and a body of a quarter less inertia, 1.77; these are
assumed, as the vehicle is. Gain of the speed loop: the usual 6 dB. Delay: a command half a step late; for the speed,
half a second."""
ROCKED_MAX_DEG, STAYS_UP_DEG = 5.0, 20.0
BLENDED_TAU_S = {"rough": 0.6, "smooth": 0.4}
"""Scenario -> time constant of the complementary filter; fitted on seeds 0-19."""
LIMITS: Limits = {
    **{
        (name, "tuned", "open"): (Limit("angle_rmse_deg", "at most", most_deg, "deg"),)
        for name, most_deg in OPEN_RMS_DEG.items()
    },
    **{
        (name, "tuned", "closed"): (
            Limit("angle_rmse_deg", "at most", most_deg, "deg"),
            Limit("tilt_max_deg", "at most", STAYS_UP_DEG, "deg"),
        )
        for name, most_deg in CLOSED_RMS_DEG.items()
    },
    **{
        ("rocked", tuning, "open"): (Limit("angle_max_deg", "at most", ROCKED_MAX_DEG, "deg"),)
        for tuning in ("tuned", "paper_rule")
    },
}


COMPARED = {
    "paper_rule_wheel": "tilt error, paper's rule, wheel",
    "arctan": "tilt error, nothing taken off",
    "arctan_fitted": "tilt error, nothing taken off, its own fit",
    "paper_rule": "tilt error, nothing taken off, paper's rule",
}
"""Tunings of the source's filter, listed with the shipped one for comparison, and their claims."""


def open_rows(seeds: Iterable[int], compared: Mapping[str, str] = COMPARED) -> Iterator[Figure]:
    """Prescribed motion: accelerometer and gyro alone, the shipped tuning, and the source's filter for comparison."""
    expected, _ = expected_raw_dps()
    yield Figure("raw rate, over every bias there may be", "rough", "-", "deg/s rms", "near", RAW_DPS, expected)
    limits: tuple[tuple[str, float, float], ...] = (("rough", 5.84, 92.0), ("smooth", 1.54, 74.0))
    for name, alone_deg, below in limits:
        reach_deg = OPEN_RMS_DEG[name]
        batch = Batch.of(name, seeds)
        alone, raw = batch.tilt_rms(batch.accel_only_deg()), batch.rate_rms(batch.gyro_dps())
        yield Figure(
            "accelerometer only (the scenario's own figure)", name, "-", "deg rms", "near", alone_deg,
            float(np.mean(alone)), float(np.max(alone)),
        ).over(alone)  # fmt: skip
        yield Figure(
            "raw rate of these seeds", name, "-", "deg/s rms", "compared", 0.0, float(np.mean(raw)), float(np.max(raw))
        ).over(raw)
        tilt, rate = _estimate(batch, "tuned", "tilt error", "at most", reach_deg)
        yield tilt
        gain = 100.0 * (1.0 - tilt.reached / float(np.mean(alone)))
        yield Figure("below accelerometer only", name, "tuned", "%", "at least", below, gain)
        yield rate
        for tuning, claim in compared.items():
            yield from _estimate(batch, tuning, claim, "compared", reach_deg)


def _estimate(batch: Batch, tuning: str, claim: str, sense: Sense, reach_deg: float) -> tuple[Figure, Figure]:
    """Rows of a tuning's tilt error and corrected rate; sense: of the target."""
    settings = balancer.TUNINGS[tuning]
    words = native_core.run_control(quantise(settings), batch.raw, batch.setpoint)
    ideal = run_reference.run_control(settings, batch.raw, batch.setpoint)
    tilt = batch.tilt_rms(np.asarray(words["tilt_turn_q32"] * TURN_DEG))
    rate = batch.rate_rms(np.asarray(words["rate_corrected_turnps_q28"] * RATE_DPS))
    accel, gyro = batch.tilt_rms(batch.accel_only_deg()), batch.tilt_rms(batch.gyro_only_deg())
    asked_deg, asked_dps = (0.0, 0.0) if sense in UNASKED else (reach_deg, 0.42)
    rate_sense: Sense = "shown" if sense in UNASKED else sense
    return (
        Figure(
            claim, batch.name, tuning, "deg rms", sense, asked_deg, float(np.mean(tilt)), float(np.max(tilt)),
            float(np.mean(batch.tilt_rms(ideal["tilt_deg"]))), float(np.mean(accel)), float(np.mean(gyro)),
        ).over(tilt),
        Figure(
            "corrected rate", batch.name, tuning, "deg/s rms", rate_sense, asked_dps, float(np.mean(rate)),
            float(np.max(rate)), float(np.mean(batch.rate_rms(ideal["rate_corrected_dps"]))), None,
            float(np.mean(batch.rate_rms(batch.gyro_dps()))),
        ).over(rate),
    )  # fmt: skip


def complementary_deg(batch: Batch, measured_deg: FloatArray, tau_s: float) -> FloatArray:
    """Tilt of the complementary filter from the true start, (steps, runs); the bias is the mean of the first 3 s."""
    period_s, tilt_deg = balancer.PERIOD_US * 1e-6, batch.tilt_deg.copy()
    rate_dps = batch.gyro_dps()
    rate_dps = rate_dps - np.mean(rate_dps[: round(3.0 / period_s)], axis=0)
    for k in range(1, len(tilt_deg)):
        tilt_deg[k] = complementary_step(tilt_deg[k - 1], rate_dps[k - 1], measured_deg[k], period_s, tau_s)
    return tilt_deg


def blended_rows(seeds: Iterable[int]) -> Iterator[Figure]:
    """The complementary filter at its best, on the tilt that `tuned` measures, the axle's acceleration taken off."""
    for name, tau_s in BLENDED_TAU_S.items():
        batch = Batch.of(name, seeds)
        words = native_core.run_control(quantise(balancer.TUNED), batch.raw, batch.setpoint)
        measured_deg = np.asarray(words["tilt_measured_turn_q32"] * TURN_DEG, np.float64)
        error = batch.tilt_rms(complementary_deg(batch, measured_deg, tau_s))
        reached = float(np.mean(error))
        yield Figure(
            "complementary filter, float64", name, f"tau {tau_s:g} s", "deg rms", "shown", 0.0, reached,
            float(np.max(error)), reached, float(np.mean(batch.tilt_rms(batch.accel_only_deg()))),
            float(np.mean(batch.tilt_rms(batch.gyro_only_deg()))),
        ).over(error)  # fmt: skip


def rocked_rows(seeds: Iterable[int]) -> Iterator[Figure]:
    """The paper's claim for a vehicle rocked by hand: largest error of a run before and after the filter."""
    batch = Batch.of("rocked", seeds)

    def peaks(tilt_deg: FloatArray) -> FloatArray:
        return np.asarray(np.max(np.abs(metrics.wrap_deg(tilt_deg - batch.tilt_deg)[batch.scored]), axis=0), np.float64)

    before = peaks(batch.accel_only_deg())
    yield Figure(
        "before the filter, largest error", "rocked", "-", "deg", "compared", 0.0, float(np.mean(before)),
        float(np.max(before)), source="+-10 deg",
    ).over(before)  # fmt: skip
    for tuning in ("tuned", "paper_rule"):
        settings = balancer.TUNINGS[tuning]
        words = native_core.run_control(quantise(settings), batch.raw, batch.setpoint)
        after = peaks(np.asarray(words["tilt_turn_q32"] * TURN_DEG))
        ideal = peaks(run_reference.run_control(settings, batch.raw, batch.setpoint)["tilt_deg"])
        yield Figure(
            "after the filter, largest error", "rocked", tuning, "deg", "at most", ROCKED_MAX_DEG,
            float(np.mean(after)), float(np.max(after)), float(np.mean(ideal)), float(np.mean(before)),
            source="+-5 deg",
        ).over(after)  # fmt: skip


def closed_rows(seeds: Iterable[int]) -> Iterator[Figure]:
    """Closed loop on the estimate, with the integers and with float64: tilt error, and that no vehicle falls."""
    tuning, runs = balancer.TUNED, list(seeds)
    for name in ("rough", "smooth"):
        reach_deg = CLOSED_RMS_DEG[name]
        ours = [balanced(tuning, name, seed) for seed in runs]
        ideal = [balance(Float64(tuning), name, seed) for seed in runs[:FLOAT_SEEDS]]
        yield from _balanced("closed loop, tilt error", name, reach_deg, ours, ideal)
        yield from following_rows(name, ours)


def following_rows(name: str, ours: list[Balanced]) -> Iterator[Figure]:
    """Velocity asked for minus true velocity, on the runs of the closed loop."""
    for claim, word in (
        ("velocity asked for minus velocity", "velocity_rms_mps"),
        (f"the same, {SETTLED_S:g} s after a command and later", "settled_rms_mps"),
    ):
        slips = [float(getattr(run, word)) for run in ours]
        row = Figure(claim, name, "tuned", "m/s rms", "shown", 0.0, float(np.mean(slips)), max(slips))
        yield row.over(np.array(slips))


def endured_rows(seeds: Iterable[int]) -> Iterator[Figure]:
    """Ten minutes of every seed, without float64, which the shorter runs cover."""
    ours = [balanced(balancer.TUNED, "endure", seed) for seed in seeds]
    yield from _balanced("ten minutes, tilt error", "endure", CLOSED_RMS_DEG["endure"], ours, [])


def _balanced(claim: str, name: str, reach_deg: float, ours: list[Balanced], ideal: list[Balanced]) -> Iterator[Figure]:
    error, in_float = ([run.error_rms_deg for run in runs] for runs in (ours, ideal))
    yield Figure(
        claim, name, "tuned", "deg rms", "at most", reach_deg, float(np.mean(error)), max(error),
        paired(error, in_float) if in_float else None,
    ).over(np.array(error))  # fmt: skip
    leaned, in_float = ([run.tilt_max_deg for run in runs] for runs in (ours, ideal))
    claim = "stays up: largest tilt of any run"
    yield Figure(
        claim, name, "tuned", "deg", "at most", STAYS_UP_DEG, max(leaned), max(leaned), max(in_float, default=None)
    )


def loop_rows(_seeds: Iterable[int]) -> Iterator[Figure]:
    """Margins of both loops, the wheels rolling, by the linear model of the vehicle."""
    for loop, margins in loops.margins().items():
        yield from loop_figures.rows(f"{loop} loop", margins, "rough", loops.TUNING, LEAST_MARGINS[loop], "model")


SECTIONS: dict[str, Callable[[Iterable[int]], Iterator[Figure]]] = {
    "open loop": open_rows,
    "blended": blended_rows,
    "rocked": rocked_rows,
    "closed loop": closed_rows,
    "ten minutes": endured_rows,
    "loops": loop_rows,
}
