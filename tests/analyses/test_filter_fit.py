"""Q and R by maximum likelihood: recovered from recordings with known Q and R, and consistent afterwards."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from plumb.analyses.identification import filter_inputs, filter_page, likelihood
from plumb.analyses.identification.innovations import Measured, Variances, innovations
from plumb.analyses.identification.noise_fit import DROP
from plumb.errors import UsageError
from plumb.kernels.reference.kernels import kalman_init, kalman_step
from plumb.spec.arrays import FloatArray
from plumb.spec.tuning import Kalman, Start
from support.declared_systems import without_group

pytest.importorskip("scipy", reason="scipy is not installed: the extra tune")

PERIOD_S = 0.01
TRUE = Variances(0.02, 0.004, 0.5)
WRONG = Variances(0.3, 1e-4, 4.0)


def motion(seed: int, steps: int, true: Variances = TRUE) -> tuple[FloatArray, FloatArray, FloatArray]:
    """True tilt, the gyro's rate and the accelerometer's tilt of a swing, with noises of those variances; the gyro's
    sample drives the step after it."""
    rng = np.random.default_rng(seed)
    rate = 30.0 * np.sin(2.0 * PERIOD_S * np.arange(steps))
    bias = 1.0 + np.cumsum(np.sqrt(true.q_bias_dps2_per_s * PERIOD_S) * rng.standard_normal(steps))
    tilt = np.concatenate([[0.0], np.cumsum(rate[:-1] * PERIOD_S)])
    gyro = rate + bias + np.sqrt(true.q_angle_deg2_per_s / PERIOD_S) * rng.standard_normal(steps)
    return tilt, gyro, tilt + np.sqrt(true.r_deg2) * rng.standard_normal(steps)


def measured(seed: int, steps: int = 4000, true: Variances = TRUE) -> Measured:
    _, gyro, z_deg = motion(seed, steps, true)
    return Measured(PERIOD_S, z_deg, np.concatenate([gyro[:1], gyro[:-1]]), np.zeros(steps), 1e9)


def test_the_filter_is_the_reference_model() -> None:
    """The same innovations as plumb.kernels.reference.kernels.kalman_step, with R that varies."""
    rng = np.random.default_rng(4)
    given = measured(1, 500)
    growing = Measured(PERIOD_S, given.z_deg, given.rate_dps, 5.0 * rng.random(500), 3.0)
    found = innovations(growing, TRUE)
    r_deg2 = np.minimum(TRUE.r_deg2 + growing.growth_deg2, 3.0)
    start = Start(float(given.z_deg[0]), 0.0, float(r_deg2[0]), 0.0, 25.0)
    state, settings = kalman_init(start), Kalman(TRUE.q_angle_deg2_per_s, TRUE.q_bias_dps2_per_s, "current")
    expected = []
    for z, rate, r in zip(given.z_deg.tolist(), given.rate_dps.tolist(), r_deg2.tolist(), strict=True):
        kalman_step(state, settings, PERIOD_S, z, rate, r)
        expected.append(state.innovation_deg)
    assert found.innovation_deg == pytest.approx(np.array(expected[growing.settled :]), abs=1e-9)
    assert found.tilt_deg[-1] == pytest.approx(state.tilt_deg)


def test_known_variances_are_recovered_within_their_confidence() -> None:
    """95 % intervals: of 6 recordings, fewer than 5 holding the truth has a chance of 3 %."""
    held = dict.fromkeys(likelihood.NAMES, 0)
    for seed in range(6):
        fit = likelihood.fit(measured(seed, 2500), WRONG)
        for name in likelihood.NAMES:
            figure = fit.figures.get(name)
            held[name] += figure is None or figure.low <= getattr(TRUE, name) <= figure.high
        most = DROP * bool(fit.kept) + 0.05
        assert fit.after.loss <= innovations(measured(seed, 2500), TRUE).loss + most
    assert min(held.values()) >= 5, held


def test_the_filter_is_consistent_afterwards_and_was_not_before() -> None:
    fit = likelihood.fit(measured(3, 2500), Variances(1e-4, 1e-8, 0.1))
    # or the start was no bad one: NIS 6.2, 56 % inside are seen; 1 and 95 % are right.
    assert fit.before.mean_nis > 4.0 and fit.before.inside < 0.8 and fit.before.whiteness < 1e-3
    # The mean of 2,300 squares of unit normals scatters by (2 / 2300) ** 0.5, 3 %, less what is fitted: 0.999.
    assert fit.after.mean_nis == pytest.approx(1.0, abs=0.02)
    # Of 2,300 the share scatters by 0.0045: three times that; white is what a test at 1 % does not refuse.
    assert fit.after.inside == pytest.approx(0.95, abs=0.015) and fit.after.whiteness > 0.01
    # Of log-likelihood: 4,000 are seen, 2 are significant.
    assert fit.gain > 100.0


def test_a_walk_that_the_recording_does_not_show_stays_as_it_was() -> None:
    fit = likelihood.fit(measured(2, 2000, Variances(0.02, 0.0, 0.5)), Variances(0.3, 1e-6, 4.0))
    assert fit.kept == ("q_bias_dps2_per_s",) and fit.variances.q_bias_dps2_per_s == pytest.approx(1e-6)


def recording(folder: Path, steps: int = 3000, reference: bool = True) -> Path:
    tilt, gyro, z_deg = motion(5, steps)
    zero = np.zeros(steps)
    columns = {
        "gyr": np.radians(np.column_stack([gyro, zero, zero])),
        "acc": 9.80665 * np.column_stack([zero, np.sin(np.radians(z_deg)), np.cos(np.radians(z_deg))]),
        "rate_hz": np.float64(1.0 / PERIOD_S),
    }
    if reference:
        half = np.radians(tilt) / 2.0
        columns["ref_quat"] = np.column_stack([np.cos(half), np.sin(half), zero, zero])
    path = folder / "swing.npz"
    np.savez(path, **columns)  # type: ignore[arg-type]
    return path


def test_a_recording_in_a_file_gives_the_same(tmp_path: Path) -> None:
    inputs = filter_inputs.inputs_of(recording(tmp_path), "quad", None, "x", None, None)
    fit = likelihood.fit(inputs.measured, inputs.start)
    assert (inputs.tuning_name, inputs.tuning.period_us) == ("recording", 10_000)
    # A variance of 2,500 samples scatters by 3 %: three times that.
    assert fit.variances.r_deg2 == pytest.approx(TRUE.r_deg2, rel=0.1)
    assert filter_page.useful(inputs, fit) and not filter_page.warnings(inputs, fit)
    before, after = (filter_page.tilt_rmse_deg(inputs, one) for one in (fit.before, fit.after))
    assert before is not None and after is not None and after < before
    chosen = filter_inputs.inputs_of(recording(tmp_path), "quad", "constant", "x", None, 20.0)
    assert chosen.start.r_deg2 == 4.0 and len(chosen.measured.z_deg) == 2000
    assert chosen.tuning.calibration == inputs.tuning.calibration


def test_settings_that_make_the_estimate_worse_are_not_offered(tmp_path: Path) -> None:
    """An accelerometer whose error is slow, and so no white noise: the likelihood trusts it, and the tilt is worse."""
    path = recording(tmp_path)
    with np.load(path) as file:
        columns = dict(file)
    slow = np.radians(6.0 * np.sin(np.arange(3000) / 60.0))
    tilt = 2.0 * np.arctan2(columns["ref_quat"][:, 1], columns["ref_quat"][:, 0]) + slow
    columns["acc"] = 9.80665 * np.column_stack([np.zeros(3000), np.sin(tilt), np.cos(tilt)])
    np.savez(path, **columns)
    inputs = filter_inputs.inputs_of(path, "quad", None, "x", None, None)
    fit = likelihood.fit(inputs.measured, inputs.start)
    assert not filter_page.useful(inputs, fit)
    assert any("grows from" in sentence for sentence in filter_page.warnings(inputs, fit))
    assert all(table.title != "To use them" for table in filter_page.tables(inputs, fit))


def test_what_cannot_be_tuned_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="300 steps are too few"):
        filter_inputs.inputs_of(recording(tmp_path, 300), "quad", None, "x", None, None)
    path = recording(tmp_path)
    with pytest.raises(UsageError, match="no tuning 'gold'"):
        filter_inputs.inputs_of(path, "quad", "gold", "x", None, None)
    other = without_group("pid", "replay")
    with pytest.raises(UsageError, match=f"{other} has no one-axis filter"):
        filter_inputs.inputs_of(path, other, None, "x", None, None)
