"""plumb.Estimator: samples of a body's sensors in units of SI, estimated by the C core in integers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

import plumb
from plumb.contract import run_fixed
from plumb.spec import declarations, parameters
from plumb.spec.arrays import FloatArray
from plumb.tuning.channels import counts_of
from support.declared_systems import of_declared

G = 9.80665
PERIOD_S = 0.01


def rocking(steps: int = 600) -> tuple[FloatArray, FloatArray]:
    """An angle in rad that swings by 20 deg, (N,), and its rate in rad/s."""
    time_s = np.arange(steps) * PERIOD_S
    angle = np.radians(20.0) * np.sin(2.0 * np.pi * 0.3 * time_s)
    return angle, np.gradient(angle, PERIOD_S)


def body(axis: str, angle: FloatArray, rate: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Gyro and accelerometer (N, 3) of a body that turns right-handed about a level axis, x or y."""
    nothing = np.zeros_like(angle)
    gyr = np.zeros((len(angle), 3))
    gyr[:, "xyz".index(axis)] = rate
    sine, cosine = G * np.sin(angle), G * np.cos(angle)
    return gyr, np.stack([nothing, sine, cosine] if axis == "x" else [-sine, nothing, cosine], axis=1)


def angle_of(system: str, estimate: plumb.Estimate) -> FloatArray:
    return estimate.pitch_rad if system == "phone" else estimate.tilt_rad


@pytest.mark.parametrize(("system", "axis"), of_declared([("quad", "x"), ("balancer", "y"), ("phone", "y")]))
@pytest.mark.parametrize("ranges", [(500.0, 4.0), (None, None)])
def test_follows_a_motion_about_its_axis(system: str, axis: str, ranges: tuple[float | None, float | None]) -> None:
    angle, rate = rocking()
    estimator = plumb.Estimator(system, period_s=PERIOD_S, gyr_range_dps=ranges[0], acc_range_g=ranges[1])
    estimate = estimator.run(*body(axis, angle, rate))
    # A tenth of the swing: a sign, an axis or a unit that is wrong costs 20 deg and more.
    assert np.abs(angle_of(system, estimate) - angle).max() < np.radians(2.0)
    assert not estimate.saturated.any()
    assert estimate.period_s == pytest.approx(PERIOD_S)


def test_turntable_turns_by_the_integral_of_its_rate() -> None:
    """At rest for the 10 s in which it takes its biases, then a quarter turn about z."""
    estimator = plumb.Estimator("turntable", "analog", gyr_range_dps=500, ang_range_dps2=1000)
    time_s = np.arange(3500) * estimator.period_s
    moving = np.clip((time_s - 11.0) / 2.0, 0.0, 1.0)
    angle = np.pi / 2 * (0.5 - 0.5 * np.cos(np.pi * moving))
    gyr = np.zeros((len(time_s), 3))
    gyr[:, 2] = np.gradient(angle, estimator.period_s)
    estimate = estimator.run(gyr, ang_radps2=np.gradient(gyr, estimator.period_s, axis=0))
    # 1 deg: the rates are difference quotients, in counts of 500 deg/s over 16 bits.
    assert estimate.yaw_rad[-1] == pytest.approx(np.pi / 2, abs=0.02)
    assert abs(estimate.roll_rad[-1]) < 0.02 and abs(estimate.pitch_rad[-1]) < 0.02


def test_a_row_of_nan_is_no_sample_where_samples_are_marked() -> None:
    gyr = np.full((10, 3), 0.1)
    gyr[3] = np.nan
    raw = plumb.Estimator("turntable").counts(gyr, ang_radps2=np.zeros((10, 3)))
    assert (raw[3, :3] == -32768).all() and (raw[[2, 4], :3] != -32768).all() and (raw[3, 3:] == 0).all()


@pytest.mark.parametrize("system", of_declared(["quad", "balancer", "phone"]))
def test_steps_equal_a_run_and_the_integer_model(system: str) -> None:
    angle, rate = rocking(200)
    gyr, acc = body("y", angle, rate)
    estimator = plumb.Estimator(system, period_s=PERIOD_S, gyr_range_dps=250, acc_range_g=2)
    whole = estimator.run(gyr, acc)
    for _ in range(2):
        steps = [estimator.step(g, a) for g, a in zip(gyr, acc, strict=True)]
        assert [step.digest for step in steps] == whole.digests.tolist()
        assert [dict(step) for step in steps[-2:]] == [{name: whole[name][k] for name in whole} for k in (-2, -1)]
        estimator.reset()
    model = run_fixed.run_control(estimator.params, whole.raw, np.zeros(len(gyr), np.int32))
    assert (model.record == whole.words.record).all()


def test_full_scale_is_clamped_and_reported() -> None:
    angle, rate = rocking(50)
    gyr, acc = body("x", angle, rate)
    gyr[20, 0] = np.radians(300.0)
    estimate = plumb.Estimator("quad", period_s=PERIOD_S, gyr_range_dps=250, acc_range_g=4).run(gyr, acc)
    assert np.flatnonzero(estimate.saturated).tolist() == [20]
    # Settings are kept within 0.1 %.
    assert np.degrees(estimate["rate_radps"][20]) == pytest.approx(250.0, rel=1e-3)


@pytest.mark.parametrize(
    ("exact", "count"),
    [(0.4, 0), (0.6, 1), (-0.4, 0), (-0.6, -1), (7.49, 7), (-7.49, -7), (99.51, 100), (-99.51, -100)],
)
def test_a_sample_becomes_the_nearest_count(exact: float, count: int) -> None:
    """Not the count below it, and not the one nearer to zero."""
    estimator = plumb.Estimator("quad", gyr_range_dps=250, acc_range_g=2)
    one_g, one_dps = 2.0 / 32766, 250.0 / 32766
    gyr, acc = np.full((1, 3), np.radians(exact * one_dps)), np.full((1, 3), exact * one_g * G)
    assert estimator.counts(gyr, acc)[0, :3].tolist() == [count] * 3


@pytest.mark.parametrize(("exact", "count"), [(0.5, 0), (1.5, 2), (2.5, 2), (-0.5, 0), (-1.5, -2), (-2.5, -2)])
def test_a_sample_half_way_becomes_the_even_count(exact: float, count: int) -> None:
    """In g and with a gain of a power of two, where every product is exact."""
    estimator = plumb.Estimator("quad")
    (channel,) = [one for one in declarations.system("quad").channels if one.axis == "acc_y"]
    row = next(row for row in parameters.table() if row.name == f"{channel.calibration}.offset")
    gain = 1 << 10
    params = replace(estimator.params, values={**estimator.params.values, "accel.offset": 0, "accel.gain": gain})
    value_g = exact * gain / 2.0 ** int(row.format[1:])
    assert counts_of(params, channel, [value_g]).tolist() == [count]


def test_other_channels_are_given_by_name() -> None:
    angle, rate = rocking(50)
    estimator = plumb.Estimator("balancer", period_s=PERIOD_S)
    edges = np.arange(50)
    raw = estimator.counts(*body("y", angle, rate), channels={"edges": edges})
    assert (raw[:, 3] == edges).all()
    with pytest.raises(plumb.UsageError, match="takes edges"):
        estimator.counts(*body("y", angle, rate), channels={"wheels": edges})
    with pytest.raises(plumb.UsageError, match="integers"):
        estimator.counts(*body("y", angle, rate), channels={"edges": edges * 0.5})


@pytest.mark.parametrize(
    ("gyr", "acc", "said"),
    [
        (np.zeros(3), np.zeros((1, 3)), "shape"),
        (np.zeros((5, 2)), np.zeros((5, 3)), "shape"),
        (np.zeros((0, 3)), np.zeros((0, 3)), "shape"),
        (np.zeros((5, 3)), np.zeros((4, 3)), "different numbers"),
        (np.zeros((5, 3)), None, "acc_mps2 is missing"),
        (np.full((5, 3), np.nan), np.zeros((5, 3)), "sample 0 is not finite"),
        (np.zeros((5, 3)), np.full((5, 3), np.inf), "acc_mps2 of sample 0"),
        ("no", np.zeros((5, 3)), "no array"),
    ],
)
def test_what_is_no_sample_is_refused(gyr: npt.ArrayLike, acc: npt.ArrayLike | None, said: str) -> None:
    with pytest.raises(plumb.UsageError, match=said):
        plumb.Estimator("quad").run(gyr, acc)


def test_a_step_is_one_sample() -> None:
    with pytest.raises(plumb.UsageError, match=r"give \(3,\)"):
        plumb.Estimator("quad").step(np.zeros((1, 3)), np.zeros((1, 3)))


def test_a_sensor_of_no_use_is_refused() -> None:
    with pytest.raises(plumb.UsageError, match="turntable estimates from gyr_radps and ang_radps2"):
        plumb.Estimator("turntable").run(np.zeros((5, 3)), np.zeros((5, 3)))
    with pytest.raises(plumb.UsageError, match="quad uses gyr_x, acc_y, acc_z"):
        plumb.Estimator("quad", ang_range_dps2=100)


@pytest.mark.parametrize("period_s", [0.0, 0.0004, 0.11, float("nan"), -1.0])
def test_a_period_out_of_range_is_refused(period_s: float) -> None:
    with pytest.raises(plumb.UsageError, match=r"0\.0005 to 0\.1"):
        plumb.Estimator("quad", period_s=period_s)


@pytest.mark.parametrize("full_scale", [0.0, -1.0, float("nan"), 1e6])
def test_a_full_scale_out_of_range_is_refused(full_scale: float) -> None:
    with pytest.raises(plumb.UsageError):
        plumb.Estimator("quad", gyr_range_dps=full_scale)


@pytest.mark.parametrize(("system", "tuning"), [("quat", None), ("quad", "adaptiv")])
def test_wrong_names_are_refused(system: str, tuning: str | None) -> None:
    with pytest.raises(plumb.UsageError, match="quad"):
        plumb.Estimator(system, tuning)


def test_a_tuning_of_another_system_is_refused() -> None:
    with pytest.raises(plumb.UsageError, match="of quad"):
        plumb.Estimator("balancer", plumb.Estimator("quad").tuning)


def test_a_signal_that_the_system_does_not_have_is_named_with_the_nearest() -> None:
    estimate = plumb.Estimator("quad").run(np.zeros((5, 3)), np.tile([0.0, 0.0, G], (5, 1)))
    with pytest.raises(AttributeError, match="Estimate of quad has no 'quaternion'"):
        _ = estimate.quaternion
    with pytest.raises(KeyError, match=r"quad has no signal 'tilt_dge' \(did you mean tilt_deg\?\)"):
        _ = estimate["tilt_dge"]
    with pytest.raises(AttributeError, match=r"did you mean saturated\?"):
        _ = estimate.saturatd
    assert not hasattr(estimate, "roll_deg") and "tilt_deg" in estimate and "roll_deg" not in estimate
    assert {"tilt_deg", "tilt_rad", "digests"} <= set(dir(estimate))


def test_a_signal_has_one_name_a_unit_on_estimates_steps_and_runs() -> None:
    estimator = plumb.Estimator("quad", period_s=0.005)
    acc = G * np.tile([0.0, np.sin(0.1), np.cos(0.1)], (200, 1))
    step, estimate = estimator.step(np.zeros(3), acc[0]), estimator.run(np.zeros((200, 3)), acc)
    result = plumb.run("quad", board="native", open_loop=True, seconds=1)
    for found in (step, estimate, result):
        for name in ("tilt", "bias", "rate"):
            deg, rad = ("_deg", "_rad") if name == "tilt" else ("_dps", "_radps")
            assert np.array_equal(found[name + deg], getattr(found, name + deg))
            assert np.allclose(found[name + rad], np.radians(found[name + deg]), rtol=1e-12)
    assert "tilt_rad" in list(estimate) and "tilt_deg" in list(result)


def test_roll_pitch_and_yaw_are_those_of_the_attitude() -> None:
    """Turned by yaw about z, then by pitch about y, then by roll about x; from the quaternion of each step."""
    estimator = plumb.Estimator("attitude", period_s=0.01)
    up = np.array([-np.sin(0.3), np.sin(0.2) * np.cos(0.3), np.cos(0.2) * np.cos(0.3)])  # roll 0.2, pitch 0.3
    estimate = estimator.run(np.zeros((300, 3)), np.tile(G * up, (300, 1)))
    # Counts of the default range are 1 mg: 1e-3 rad an axis.
    assert estimate.roll_rad[-1] == pytest.approx(0.2, abs=2e-3)
    assert estimate.pitch_deg[-1] == pytest.approx(np.degrees(0.3), abs=0.1)
    half = 0.5 * np.array([estimate[f"{angle}_rad"] for angle in ("roll", "pitch", "yaw")])
    (cr, cp, cy), (sr, sp, sy) = np.cos(half), np.sin(half)
    w, x = cr * cp * cy + sr * sp * sy, sr * cp * cy - cr * sp * sy
    y, z = cr * sp * cy + sr * cp * sy, cr * cp * sy - sr * sp * cy
    # The angles come of the rounded quaternion, and lose no more than float32 would.
    assert np.allclose(estimate.quaternion, np.stack([w, x, y, z], axis=-1), atol=1e-6)
    assert list(name for name in estimate if name.startswith("attitude_")) == [f"attitude_{part}" for part in "wxyz"]
    assert estimate.quaternion.shape == (300, 4)
