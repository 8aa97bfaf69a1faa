"""Targets of `quad` and the figures that the integers reach (see plumb.proof.figures).

Figures are over seeds 1000-1039; tunings were fitted on seeds 0-19. Rows of estimators use prescribed motion; `hold` is
a closed loop on the estimate. The float64 column is `plumb.contract.run_reference` with the same tuning and counts.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import cast

import numpy as np
import numpy.typing as npt

from plumb.boards.native import core as native_core
from plumb.boards.native import plant as native_plant
from plumb.contract.parameters import ControlParams, quantise
from plumb.judging.quad import loops
from plumb.judging.quad import plots as quad_plots
from plumb.kernels.reference import kernels as reference_kernels
from plumb.kernels.reference.blending import complementary_step, weighted_average
from plumb.physics.sensors import ADC_NOISE_LSB, Mma7260
from plumb.proof import loop_figures, metrics
from plumb.proof.figures import FLOAT_SEEDS, Figure, Sense, paired
from plumb.proof.limits import Limit
from plumb.proof.loop_figures import LeastMargins
from plumb.proof.report import ESTIMATE, SECOND, SENSOR, TRUTH, Line, Plot
from plumb.proof.runs import Run, open_loop, prescribed
from plumb.spec.arrays import FloatArray
from plumb.systems import scoring
from plumb.systems.quad import lateral
from plumb.systems.quad import plant as quad_plant
from plumb.systems.quad import reference as reference_quad
from plumb.systems.quad import scenarios as quad
from plumb.systems.quad.drawn_run import Scenario
from plumb.systems.quad.plant import QuadPlant
from plumb.systems.quad.tuning import QuadTuning
from plumb.tuning.variances import lsb_of

HEADLINE = ("tilt error", "motion", "trapezium")
PLOTTED_SEED = 1000

ASSUMED = (
    "Scores t >= 10 s (runs under 20 s: the second half); tunings fitted on seeds 0-19; atan2 of the sampled values.",
    f"Assumed: gyro noise {quad.GYRO_NOISE_DPS} deg/s, bias +-{quad.BIAS_DPS:g} and drift {quad.DRIFT_DPS:g} deg/s in"
    f" {quad.DRIFT_TAU_S:g} s, walk {quad.WALK_DPS_PER_RTS} deg/s/sqrt(s), scale {100 * quad.SCALE_ERROR:g} %;",
    f"accelerometer offset {1e3 * quad.OFFSET_G:g} mg, vibration {lateral.VIBRATION_G} g at 2-12 Hz, {quad.BURSTS}"
    f" bursts of {lateral.BURST_G} g; ADC noise {ADC_NOISE_LSB} LSB. Gyro only: bias taken from the first 3 s.",
    "quiet: the accelerometer's offset is the largest part of what the tunings for quiet leave: it is the mean error of"
    " a run. `adaptive` trusts the gyro for seconds, and the printed U, the gyro's previous sample, is half a period"
    " late; `trapezium` undoes that.",
    "Complementary filter and weighted average, which the firmware does not have: float64, constants fitted on seeds"
    " 0-19 of the scenario; the gyro as in gyro only.",
    f"Hold: inertia {quad_plant.INERTIA_KGM2} kg m^2, arm {quad_plant.ARM_M} m, thrust {quad_plant.THRUST_N:g} N,"
    f" motor lag {1e3 * quad_plant.MOTOR_TAU_S:g} ms, imbalance {quad_plant.IMBALANCE_NM} and gusts"
    f" {quad_plant.GUST_NM} Nm.",
    f"Margins: of the loop broken at the command; the model takes {1e3 * loops.PULSE_DELAY_S:g} ms from a sample to its"
    " thrust. tools/gen_margins.py identifies those of the flash image.",
)


LATE_MS, LATE_MAX_DEG = 20.0, 10.0
"""Further delay that `hold` survives, and the tilt that a limit cycle would pass: half the disturbance."""
BLENDED = {"motion": (0.4, 0.001), "quiet": (0.08, 0.001)}
"""Scenario -> time constant of the complementary filter in s, weight of the gyro in the weighted average; fitted on
seeds 0-19."""
CONSISTENT = (0.5, 1.4)
"""Spread of the error about its mean, in the filter's own sigma, of a tuning whose variance can be believed."""

LIMITS = {
    ("motion", "adaptive", "open"): (Limit("angle_rmse_deg", "at most", 0.60, "deg"),),
    ("quiet", "adaptive", "open"): (Limit("angle_rmse_deg", "at most", 0.40, "deg"),),
    ("motion", "trapezium", "open"): (Limit("angle_rmse_deg", "at most", 0.60, "deg"),),
    ("quiet", "trapezium", "open"): (Limit("angle_rmse_deg", "at most", 0.40, "deg"),),
    ("quiet", "quiet", "open"): (Limit("angle_rmse_deg", "at most", 0.33, "deg"),),
}


@dataclass(frozen=True)
class Estimate:
    """Tilt in deg and bias in deg/s, (steps, runs)."""

    tilt_deg: FloatArray
    bias_dps: FloatArray


@dataclass(frozen=True)
class Batch:
    """One scenario's runs: raw (steps, 6, runs) counts, truth (steps, runs)."""

    name: str
    raw: npt.NDArray[np.int16]
    tilt_deg: FloatArray
    bias_dps: FloatArray
    time_s: FloatArray

    @classmethod
    def of(cls, name: str, seeds: Iterable[int], bandwidth_hz: float = 350.0) -> Batch:
        runs = [quad.scenario(name, seed, bandwidth_hz=bandwidth_hz) for seed in seeds]
        return cls(
            name,
            np.stack([run.counts() for run in runs], axis=-1),
            np.stack([run.tilt_deg() for run in runs], axis=-1),
            np.stack([run.bias_dps for run in runs], axis=-1),
            runs[0].time_s,
        )

    def rmse_deg(self, tilt_deg: FloatArray) -> FloatArray:
        """Rms of the error of every run, (runs,)."""
        return metrics.angle_rmse_deg(tilt_deg, self.tilt_deg, scoring.scored(self.time_s))

    def engineering(self) -> FloatArray:
        """Rate in deg/s, acceleration along y and z in g: (3, steps, runs)."""
        channels = (quad.CALIBRATION.gyro, quad.CALIBRATION.accel, quad.CALIBRATION.accel_up)
        raw = self.raw.astype(np.float64)
        return np.stack([(raw[:, i] - c.zero_counts) * c.unit_per_count for i, c in enumerate(channels)])

    def accel_only_deg(self) -> FloatArray:
        _, y_g, z_g = self.engineering()
        return metrics.accel_only_deg(y_g, z_g)

    def gyro_only_deg(self) -> FloatArray:
        return metrics.gyro_only_deg(self.engineering()[0], quad.PERIOD_US * 1e-6, self.tilt_deg[:1])


def float64(tuning: QuadTuning, raw: npt.NDArray[np.int16]) -> Estimate:
    """The estimator of the reference over many runs, from counts."""
    words = reference_quad.run_filter(tuning, raw)
    return Estimate(words["tilt_deg"], words["bias_dps"])


def integers(tuning: QuadTuning, raw: npt.NDArray[np.int16]) -> Estimate:
    """The C integers over many runs, from the same counts."""
    params = quantise(tuning)
    words = native_core.run_control(params, raw, np.zeros((raw.shape[0], raw.shape[2]), np.int32))
    tilt_turn, bias_turnps = words["tilt_turn_q32"] / 2.0**32, words["bias_turnps_q28"] / 2.0**28
    return Estimate(np.asarray(360.0 * tilt_turn, np.float64), np.asarray(360.0 * bias_turnps, np.float64))


def complementary_deg(batch: Batch, tau_s: float) -> FloatArray:
    """Tilt of the complementary filter from the true start, (steps, runs); the bias is the mean of the first 3 s."""
    rate_dps, period_s = batch.engineering()[0], quad.PERIOD_US * 1e-6
    rate_dps = rate_dps - np.mean(rate_dps[: round(3.0 / period_s)], axis=0)
    measured_deg, tilt_deg = batch.accel_only_deg(), batch.tilt_deg.copy()
    for k in range(1, len(tilt_deg)):
        tilt_deg[k] = complementary_step(tilt_deg[k - 1], rate_dps[k - 1], measured_deg[k], period_s, tau_s)
    return tilt_deg


def blended_rows(seeds: Iterable[int]) -> Iterator[Figure]:
    """Complementary filter and weighted average, the source's alternatives to the Kalman filter, at their best."""
    for name, (tau_s, weight) in BLENDED.items():
        batch = Batch.of(name, seeds)
        gyro_deg, accel_deg = batch.gyro_only_deg(), batch.accel_only_deg()
        for claim, constant, tilt_deg in (
            ("complementary filter, float64", f"tau {tau_s:g} s", complementary_deg(batch, tau_s)),
            ("weighted average, float64", f"gyro {weight:g}", weighted_average(gyro_deg, accel_deg, weight)),
        ):
            error = batch.rmse_deg(tilt_deg)
            reached = float(np.mean(error))
            yield Figure(
                claim, name, constant, "deg rms", "shown", 0.0, reached, float(np.max(error)), reached,
                float(np.mean(batch.rmse_deg(accel_deg))), float(np.mean(batch.rmse_deg(gyro_deg))),
            ).over(error)  # fmt: skip


def estimator_rows(seeds: Iterable[int]) -> Iterator[Figure]:
    """`motion` and `quiet`: accelerometer alone, the paper's constants, and the shipped tunings."""
    motion, quiet = Batch.of("motion", seeds), Batch.of("quiet", seeds)
    most = {key[:2]: limit.value for key, (limit,) in LIMITS.items()}
    alone = motion.rmse_deg(motion.accel_only_deg())
    yield Figure(
        "accelerometer only (the scenario's own figure)", "motion", "-", "deg rms", "near", 2.40,
        float(np.mean(alone)), float(np.max(alone)),
    ).over(alone)  # fmt: skip
    yield _tilt_error("paper's constants (the scenario's own figure)", motion, "paper", "near", 1.87)
    yield _tilt_error("paper's constants and its arcsine", motion, "paper_arcsine", "shown", 0.0)
    yield _tilt_error("best constant R", motion, "constant", "shown", 0.0)
    error = _tilt_error("tilt error", motion, "trapezium", "at most", most["motion", "trapezium"])
    yield error
    gain = 100.0 * (1.0 - error.reached / float(np.mean(alone)))
    yield Figure("below accelerometer only", "motion", "trapezium", "%", "at least", 75.0, gain)
    yield _tilt_error("tilt error, the same parameters", quiet, "trapezium", "at most", most["quiet", "trapezium"])
    for batch in (motion, quiet):
        claim = "tilt error, U as printed"
        yield _tilt_error(claim, batch, "adaptive", "at most", most[batch.name, "adaptive"])
    yield _tilt_error("tilt error, tuned for quiet", quiet, "quiet", "at most", most["quiet", "quiet"])
    yield _tilt_error("tilt error, fitted for quiet", quiet, "quiet_fitted", "compared", 0.0)
    yield _tilt_error("paper's constants", quiet, "paper", "compared", 0.0)
    yield _tilt_error("the paper's Q, its own R, a fast start", quiet, "fast_start", "compared", 0.0)
    for tuning in ("quiet_fitted", "fast_start"):
        yield _tilt_error("the same on motion", motion, tuning, "shown", 0.0)
    for batch, tuning in ((motion, "adaptive"), (motion, "trapezium"), (quiet, "trapezium"), (quiet, "quiet")):
        yield from _consistency(batch, tuning, "at most" if tuning == "trapezium" else "shown")


def _consistency(batch: Batch, tuning: str, sense: Sense) -> Iterator[Figure]:
    """Mean and spread of a run's error, each by itself, and the spread compared with the sigma that the filter
    states."""
    settings = quad.TUNINGS[tuning]
    params, window = quantise(settings), scoring.scored(batch.time_s)
    words = native_core.run_control(params, batch.raw, np.zeros((batch.raw.shape[0], batch.raw.shape[2]), np.int32))
    tilt_deg = np.asarray(words["tilt_turn_q32"] * quad_plots.TURN_DEG, np.float64)
    runs = [
        metrics.Consistency.of(tilt_deg[:, run], batch.tilt_deg[:, run], window, words["p00"][:, run], lsb_of(params))
        for run in range(tilt_deg.shape[1])
    ]
    for claim, unit, asked, reach, values in (
        ("mean error of a run, its size", "deg", "shown", 0.0, [abs(run.mean) for run in runs]),
        ("spread about that mean", "deg, sd", "shown", 0.0, [run.spread for run in runs]),
        ("spread, of the filter's own sigma", "times", sense, CONSISTENT[1], [run.per_sigma for run in runs]),
    ):
        yield Figure(
            claim, batch.name, tuning, unit, cast(Sense, asked), 0.0 if asked == "shown" else reach,
            float(np.mean(values)), max(values),
        ).over(np.array(values))  # fmt: skip


def _tilt_error(claim: str, batch: Batch, tuning: str, sense: Sense, reach: float) -> Figure:
    settings = quad.TUNINGS[tuning]
    error = batch.rmse_deg(integers(settings, batch.raw).tilt_deg)
    return Figure(
        claim,
        batch.name,
        tuning,
        "deg rms",
        sense,
        reach,
        reached=float(np.mean(error)),
        worst=float(np.max(error)),
        reference=float(np.mean(batch.rmse_deg(float64(settings, batch.raw).tilt_deg))),
        accel_only=float(np.mean(batch.rmse_deg(batch.accel_only_deg()))),
        gyro_only=float(np.mean(batch.rmse_deg(batch.gyro_only_deg()))),
    ).over(error)


def convergence_rows(seeds: Iterable[int]) -> Iterator[Figure]:
    """`converge`: the paper's constants, then the shipped tunings."""
    batch = Batch.of("converge", seeds)
    claims: tuple[tuple[str, str, Sense, float], ...] = (
        ("bias within 1 deg/s (the scenario's own figure)", "paper", "near", 1.5),
        ("bias within 1 deg/s, only its start-up mode changed", "paper, fast", "shown", 0.0),
        ("bias within 1 deg/s", "fast_start", "at most", 0.5),
        ("bias within 1 deg/s", "adaptive", "at most", 0.5),
        ("bias within 1 deg/s", "trapezium", "at most", 0.5),
    )
    for claim, tuning, sense, reach in claims:
        base, _, start = tuning.partition(", ")
        settings = quad.TUNINGS[base]
        settings = replace(settings, start=quad.STARTS[start]) if start else settings
        ours, ideal = (_converged(batch, run(settings, batch.raw)) for run in (integers, float64))
        times = [run.time_s for run in ours]
        reference_s = float(np.median([run.time_s for run in ideal]))
        median_s = float(np.median(times))
        source = "faster: future work" if sense == "at most" else ""
        yield Figure(
            claim, "converge", tuning, "s, median", sense, reach, median_s, max(times), reference_s, source=source
        )
    after = max(run.angle_max_deg for run in ours)
    after_ideal = max(run.angle_max_deg for run in ideal)
    yield Figure("angle from then on", "converge", "trapezium", "deg max", "at most", 2.0, after, after, after_ideal)


def _converged(batch: Batch, estimate: Estimate) -> list[metrics.Convergence]:
    bias, tilt = estimate.bias_dps - batch.bias_dps, estimate.tilt_deg - batch.tilt_deg
    period_s = quad.PERIOD_US * 1e-6
    return [metrics.convergence(bias[:, run], tilt[:, run], period_s) for run in range(bias.shape[1])]


class Float64:
    """`plumb.contract.run_reference`, from counts to pulses in us."""

    def __init__(self, tuning: QuadTuning) -> None:
        self.tuning, self.state = tuning, reference_quad.QuadReferenceState(reference_kernels.kalman_init(tuning.start))

    def pulses_us(self, raw: tuple[int, ...], setpoint: int) -> tuple[float, float]:
        tuning, channels = self.tuning, self.tuning.calibration
        rate_dps = reference_kernels.calibrate(float(raw[0]), channels.gyro)
        y_g, z_g = (
            reference_kernels.calibrate(float(count), channel)
            for count, channel in zip(raw[1:3], (channels.accel, channels.accel_up), strict=True)
        )
        z_deg, r_deg2 = reference_kernels.tilt(y_g, z_g, tuning.tilt), reference_kernels.trust(y_g, z_g, tuning.trust)
        asked_deg = setpoint * (360.0 / 2.0**32)
        step = reference_quad.control_step(self.state, tuning, rate_dps, z_deg, r_deg2, asked_deg)
        return float(step["pulse_0_us"]), float(step["pulse_1_us"])


def hold_rows(seeds: Iterable[int]) -> Iterator[Figure]:
    """`hold`: closed loop on the estimate, with the integers (and once with float64), scored on the true tilt."""
    tuning = quad.HOLD
    seeds, params = list(seeds), quantise(tuning)
    ours = [held(params, seed) for seed in seeds]
    ideal = [hold_run(Float64(tuning), seed) for seed in seeds[:FLOAT_SEEDS]]
    late = [held(params, seed, LATE_MS) for seed in seeds]
    for claim, unit, reach, name, runs, in_float in (
        ("20 deg disturbance, back within 2 deg", "s", 2.0, "recovery_s", ours, ideal),
        ("holds, from 2 s after", "deg rms", 1.0, "rms_deg", ours, ideal),
        (f"holds with {LATE_MS:g} ms of further delay", "deg rms", 1.0, "rms_deg", late, None),
        (f"largest tilt with {LATE_MS:g} ms of further delay", "deg max", LATE_MAX_DEG, "max_deg", late, None),
    ):
        values = [float(getattr(run, name)) for run in runs]
        floats = None if in_float is None else paired(values, [float(getattr(run, name)) for run in in_float])
        row = Figure(claim, "hold", "hold", unit, "at most", reach, float(np.mean(values)), max(values), floats)
        yield row.over(np.array(values))


def held(params: ControlParams, seed: int, delay_ms: float = 0.0) -> metrics.Hold:
    """One closed loop of the integers."""
    scenario = quad.scenario("hold", seed, delay_ms=delay_ms)
    return _hold(scenario, native_plant.closed_loop(scenario, params).truth["tilt_deg"])


def hold_run(controller: Float64, seed: int) -> metrics.Hold:
    """One closed loop in float64: the plant's counts in, the pulses of the same step out."""
    scenario = quad.scenario("hold", seed)
    plant = QuadPlant(scenario)
    tilt_deg = np.empty(scenario.steps)
    pulse_us = (quad.ADAPTIVE.esc.mid_us, quad.ADAPTIVE.esc.mid_us)
    for k, time_s in enumerate(scenario.time_s.tolist()):
        plant.advance_to(time_s, pulse_us)
        pulse_us = controller.pulses_us(plant.counts(time_s), plant.setpoint(time_s))
        tilt_deg[k] = plant.tilt_deg
    return _hold(scenario, tilt_deg)


def _hold(scenario: Scenario, tilt_deg: FloatArray) -> metrics.Hold:
    release_s = quad.HOLD_RELEASE_S + quad.hold_later_s(scenario.seed)
    return metrics.hold(scenario.time_s, tilt_deg, np.zeros(scenario.steps), release_s)


def loop_rows(_seeds: Iterable[int]) -> Iterator[Figure]:
    """Margins of attitude hold: of the model, and on the flash image."""
    least = LeastMargins(35.0, 6.0, 1e-3 * LATE_MS)
    for found, how in ((loops.margins(), "model"), (loop_figures.identified("quad"), "flash image")):
        for loop, margins in found.items():
            yield from loop_figures.rows(loop, margins, "hold", loops.TUNING, least, how)


def bandwidth_rows(seeds: Iterable[int]) -> Iterator[Figure]:
    """`motion` with other low-passes: less bandwidth means less noise and more lag."""
    for bandwidth_hz in quad.BANDWIDTHS_HZ:
        batch = Batch.of("motion", seeds, bandwidth_hz)
        noise_mg = 1e3 * Mma7260(bandwidth_hz).noise_g
        yield _tilt_error(f"low-pass {bandwidth_hz:.0f} Hz, {noise_mg:.1f} mg", batch, "trapezium", "at most", 0.60)


def disturbed(tuning: str) -> tuple[Run, Plot, Plot]:
    """`disturb` on the native core: the run, a plot of the tilt (measured, true, fused), and one of the bias."""
    from plumb.boards.native.board import NativeBoard

    run = quad.scenario("disturb", PLOTTED_SEED)
    trial = open_loop(NativeBoard(), prescribed(run), quantise(quad.TUNINGS[tuning]))
    time_s, words, truth = run.time_s, trial.words, trial.inputs.truth
    tilt = Plot(
        f"Tilt, {quad.TUNING_NOTES[tuning]}",
        "deg",
        time_s,
        [
            Line("accelerometer", words["tilt_measured_turn_q32"] * quad_plots.TURN_DEG, SENSOR, 0.7),
            Line("true", truth["tilt_deg"], TRUTH, 1.6),
            Line("fused", words["tilt_turn_q32"] * quad_plots.TURN_DEG, ESTIMATE),
        ],
    )
    bias = Plot(
        "Gyro bias",
        "deg/s",
        time_s,
        [
            Line("true", truth["bias_dps"], TRUTH),
            Line("estimated", words["bias_turnps_q28"] * quad_plots.RATE_DPS, ESTIMATE),
        ],
    )
    return trial, tilt, bias


def figures_2_and_3() -> list[Plot]:
    """The paper's figures: gyro and tilt as measured, bias and fused tilt, the start angle moved by hand."""
    trial, tilt, bias = disturbed("paper")
    rate = trial.words["rate_turnps_q28"] * quad_plots.RATE_DPS
    raw = Plot("Angular rate as measured", "deg/s", trial.inputs.time_s, [Line("gyro", rate, SENSOR, 0.9)])
    return [raw, tilt, bias]


def same_with_ours() -> list[Plot]:
    """The same motion and the same counts with the shipped tuning."""
    _, tilt, bias = disturbed("trapezium")
    return [tilt, bias]


def starts() -> list[Plot]:
    """`converge`: the paper's filter from a wrong initial state, with and without the start-up mode `fast`."""
    batch = Batch.of("converge", [PLOTTED_SEED])
    cases = {
        "paper": quad.TUNINGS["paper"],
        "paper, start-up mode fast": replace(quad.TUNINGS["paper"], start=quad.STARTS["fast"]),
        "trapezium (starts fast)": quad.TUNINGS["trapezium"],
    }
    found = {label: integers(tuning, batch.raw) for label, tuning in cases.items()}
    early, colours = batch.time_s < 4.0, (SENSOR, SECOND, ESTIMATE)
    tilt, bias = [], []
    for (label, estimate), colour in zip(found.items(), colours, strict=True):
        tilt.append(Line(label, (estimate.tilt_deg - batch.tilt_deg)[early, 0], colour))
        bias.append(Line(label, (estimate.bias_dps - batch.bias_dps)[early, 0], colour))
    return [
        Plot("Error of the tilt, start 30 deg wrong", "deg", batch.time_s[early], tilt),
        Plot("Error of the bias, start 5 deg/s wrong", "deg/s", batch.time_s[early], bias),
    ]


PLOTS: dict[str, Callable[[], list[Plot]]] = {
    "figures_2_and_3": figures_2_and_3,
    "trapezium": same_with_ours,
    "starts": starts,
}
SECTIONS: dict[str, Callable[[Iterable[int]], Iterator[Figure]]] = {
    "estimator": estimator_rows,
    "blended": blended_rows,
    "convergence": convergence_rows,
    "hold": hold_rows,
    "loops": loop_rows,
    "bandwidth": bandwidth_rows,
}
