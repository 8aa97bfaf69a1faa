"""Three-axis calibration: what comes of boards with known errors, any way round, and readings that are refused."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from plumb.errors import UsageError
from plumb.physics.hand import TurningHand
from plumb.spec.arrays import FloatArray
from plumb.spec.tuning import Channel
from plumb.systems.attitude.held import SensorErrors, rotations
from plumb.systems.attitude.poses import POSES, TURNS
from plumb.tuning import sides, vector_calibration
from plumb.tuning.pose_calibration import Pose
from plumb.tuning.sides import VectorReading
from plumb.tuning.vector_calibration import Fit, Turned, up

ACCEL = Channel(0.0, 1.0 / 256.0, -4096, 4095)
GYRO = Channel(0.0, 1.0 / 14.375, -28750, 28750)
RATE_HZ, REST = 200.0, 400
BY_NAME = {pose.name: pose for pose in POSES}


def errors_of(mounting: FloatArray, rng: np.random.Generator, size: float = 1.0) -> SensorErrors:
    """A part at the edge of its data sheet: zeros of 80 mg and 20 deg/s, scales off by 8 %, axes 1 % off square, on a
    board that leans by 2 degrees."""
    lean = vector_calibration.nearest_rotation(np.eye(3) + 0.035 * size * _cross(rng.uniform(-1.0, 1.0, 3)))

    def bent(scale: float) -> FloatArray:
        square = 0.01 * rng.uniform(-1.0, 1.0, (3, 3)) * ~np.eye(3, dtype=bool)
        matrix: FloatArray = np.diag(1.0 + size * scale * rng.uniform(-1.0, 1.0, 3)) @ (np.eye(3) + size * square)
        return matrix @ mounting @ lean

    zeros = size * rng.uniform(-1.0, 1.0, (2, 3))
    return SensorErrors(bent(0.08), 20.0 * zeros[0], bent(0.08), 0.08 * zeros[1])


def _cross(v: FloatArray) -> FloatArray:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def accel_counts(errors: SensorErrors, vertical: FloatArray) -> FloatArray:
    return np.asarray((errors.accel @ vertical + errors.accel_zero_g) / ACCEL.unit_per_count)


def gyro_counts(errors: SensorErrors, rates_dps: FloatArray) -> FloatArray:
    return np.asarray((rates_dps @ errors.gyro.T + errors.gyro_zero_dps) / GYRO.unit_per_count)


def means_of(errors: SensorErrors, rng: np.random.Generator, held_rad: float) -> dict[str, FloatArray]:
    """Mean counts of all poses, with the noise of two seconds; each is held aslant by this much, rms of both angles."""
    found = {}
    for pose in POSES:
        crooked = up(pose) + np.cross(held_rad * rng.standard_normal(3), up(pose))
        noise = 0.75 / np.sqrt(REST) * rng.standard_normal(3)
        found[pose.name] = accel_counts(errors, crooked / np.linalg.norm(crooked)) + noise
    return found


def turned(errors: SensorErrors, begin: str, end: str, rng: np.random.Generator, wobble_dps: float = 20.0) -> Turned:
    """A turn within 4 s by a hand that wobbles about the other axes, with true verticals at its ends."""
    hand = TurningHand({pose.name: up(pose).tolist() for pose in POSES})
    hand.put(begin)
    hand.at(2.0)
    hand.put(end, over_s=2.0)
    times = 2.0 + np.arange(1, 801) / RATE_HZ
    window = np.sin(np.pi * np.clip((times - 2.0) / 2.0, 0.0, 1.0))
    rates = np.array([hand.at(time)[1] for time in times])
    rates += wobble_dps * window[:, None] * np.sin(9.0 * times[:, None] + rng.uniform(0.0, 6.0, 3))
    true = Turned(rates, 4.0, up(BY_NAME[begin]), up(BY_NAME[end]))
    counts = np.rint(gyro_counts(errors, rates) + 4.3 * rng.standard_normal(rates.shape))
    after = true.before
    for rate in np.repeat(np.radians(rates) / RATE_HZ / 3.0, 3, axis=0):  # u' = u x w, in fine steps
        after = after + np.array(
            [
                after[1] * rate[2] - after[2] * rate[1],
                after[2] * rate[0] - after[0] * rate[2],
                after[0] * rate[1] - after[1] * rate[0],
            ]
        )
    return replace(true, counts=counts, after=after / np.linalg.norm(after))


@pytest.mark.parametrize("number", range(24))
def test_what_a_part_has_is_found_however_it_is_mounted(number: int) -> None:
    rng = np.random.default_rng(number)
    errors = errors_of(rotations()[number], rng)
    accel = vector_calibration.accelerometer(POSES, means_of(errors, rng, 0.0), ACCEL)
    # A mean has 0.0375 counts rms of noise, 0.15 mg. Zeros, scales and axes come of two means each, 0.1 mg: five
    # times that.
    assert np.allclose(accel.zeros * ACCEL.unit_per_count, errors.accel_zero_g, atol=0.5e-3)
    scales = np.linalg.norm(errors.accel, axis=1)
    assert np.allclose(ACCEL.unit_per_count / accel.units, scales, rtol=0.5e-3)
    found = accel.matrix @ np.diag(accel.units / ACCEL.unit_per_count)
    assert np.allclose(found @ errors.accel, np.eye(3), atol=0.5e-3)
    turns = [turned(errors, turn.begin, turn.end, rng) for turn in TURNS]
    zeros = gyro_counts(errors, np.zeros(3))
    gyro = vector_calibration.gyroscope(turns, zeros, GYRO, accel)
    whole = gyro.matrix @ errors.gyro
    assert np.allclose(np.diag(whole), 1.0, atol=0.01), whole  # the scales
    assert np.allclose(whole, np.eye(3), atol=0.02), whole  # what the turns do not show is no worse than it was
    assert np.linalg.det(gyro.matrix) > 0.0


@pytest.mark.parametrize("number", range(0, 24, 4))
def test_crooked_poses_cost_little_scale_and_zero(number: int) -> None:
    """Held by eye, 2 degrees rms off: scale within 0.4 %, zero within 5 mg, and axes no more askew than the hand."""
    rng = np.random.default_rng(100 + number)
    errors = errors_of(rotations()[number], rng)
    fit = vector_calibration.accelerometer(POSES, means_of(errors, rng, 0.035), ACCEL)
    assert np.allclose(ACCEL.unit_per_count / fit.units, np.linalg.norm(errors.accel, axis=1), rtol=4e-3)
    assert np.allclose(fit.zeros * ACCEL.unit_per_count, errors.accel_zero_g, atol=5e-3)
    # Of 12 draws of 0.035 rad, half of which the fit takes up.
    assert 0.01 < fit.held_rad < 0.08
    askew = fit.matrix @ np.diag(fit.units / ACCEL.unit_per_count) @ errors.accel
    assert np.max(np.abs(askew - vector_calibration.nearest_rotation(askew))) < 0.02  # crooked poses alone: 0.035


def test_a_part_without_errors_keeps_its_parameters() -> None:
    errors = errors_of(np.eye(3), np.random.default_rng(1), size=0.0)
    rest = {pose.name: accel_counts(errors, up(pose)) for pose in POSES}
    fit = vector_calibration.accelerometer(POSES, rest, ACCEL)
    sensor = fit.sensor(ACCEL)
    assert np.allclose(sensor.matrix, np.eye(3), atol=1e-12) and sensor.channel == ACCEL and fit.held_rad < 1e-12
    rng = np.random.default_rng(2)
    turns = [turned(errors, turn.begin, turn.end, rng) for turn in TURNS]
    gyro = vector_calibration.gyroscope(turns, np.zeros(3), GYRO, fit)
    assert np.allclose(gyro.matrix, np.eye(3), atol=5e-3)


def test_one_zero_for_all_axes_leaves_the_rest_of_them() -> None:
    fit = Fit(np.array([10.0, 4.0, 1.0]), np.full(3, ACCEL.unit_per_count), np.eye(3))
    sensor = fit.sensor(ACCEL)
    assert sensor.channel.zero_counts == pytest.approx(5.0)
    assert np.allclose(fit.left(sensor) / ACCEL.unit_per_count, [5.0, -1.0, -4.0])


def test_a_sensor_of_another_range_is_refused() -> None:
    errors = errors_of(np.eye(3), np.random.default_rng(3), size=0.0)
    rest = {pose.name: accel_counts(errors, up(pose)) for pose in POSES}
    with pytest.raises(UsageError, match=r"accelerometer, axis x: a count is 0\.50 times what the parameters say"):
        vector_calibration.accelerometer(POSES, rest, replace(ACCEL, unit_per_count=1.0 / 128.0))


IDEAL = errors_of(np.eye(3), np.random.default_rng(4), size=0.0)


@cache
def quarter() -> Turned:
    return turned(IDEAL, "level", "left side up", np.random.default_rng(5), wobble_dps=0.0)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (lambda _: {}, None),
        (lambda _: {"after": np.array([0.0, 0.5, 0.87])}, "it turned by 30 degrees: turn it by 90"),
        (lambda counts: {"counts": 0.0 * counts}, "the gyro hardly felt a turn of 90 degrees"),
        (
            lambda counts: {"counts": counts + 28750.0 * (np.arange(800) == 99)[:, None]},
            "at its limit: turn it more slowly",
        ),
        (lambda counts: {"counts": counts + counts[:, [1, 0, 2]]}, "it turned by x +90 deg, y +90 deg"),
        (lambda counts: {"counts": -3.0 * counts}, "the gyro felt 270 degrees, for 90: turn it once, the short way"),
        (lambda counts: {"counts": 1.6 * counts}, "gyro: a count is 0.6"),
    ],
)
def test_a_turn_that_cannot_be_used_is_refused(
    changes: Callable[[FloatArray], dict[str, FloatArray]], said: str | None
) -> None:
    turn = replace(quarter(), **changes(quarter().counts))  # type: ignore[arg-type]
    found = vector_calibration.turn_refusal(turn, np.zeros(3), GYRO, 45.0)
    assert found is None if said is None else said in (found or "")


def test_turns_about_the_same_axis_are_refused() -> None:
    rng = np.random.default_rng(6)
    fit = vector_calibration.accelerometer(POSES, {one.name: accel_counts(IDEAL, up(one)) for one in POSES}, ACCEL)
    turns = [turned(IDEAL, turn.begin, turn.end, rng) for turn in TURNS]
    with pytest.raises(UsageError, match="not about three axes of the gyro"):
        vector_calibration.gyroscope(
            [turns[0], replace(turns[1], counts=turns[0].counts), turns[2]], np.zeros(3), GYRO, fit
        )


def reading(felt_g: FloatArray, **changes: object) -> VectorReading:
    rng = np.random.default_rng(7)
    accel = felt_g / ACCEL.unit_per_count + 0.75 * rng.standard_normal((100, 3))
    taken = VectorReading(4.3 * rng.standard_normal((100, 3)), accel, 100, 2.0)
    return replace(taken, **changes)  # type: ignore[arg-type]


LEVEL = reading(np.array([0.1, -0.1, 1.05]))


@pytest.mark.parametrize(
    ("taken", "said"),
    [
        (LEVEL, None),
        (replace(LEVEL, gyro=LEVEL.gyro[:90]), "only 90 of 100 samples came"),
        (replace(LEVEL, accel=LEVEL.accel[:0], expected=0), "only 0 of 0 samples came"),
        (replace(LEVEL, gyro=20.0 * LEVEL.gyro), "the gyro felt a motion"),
        (replace(LEVEL, accel=LEVEL.accel + np.linspace(0.0, 20.0, 100)[:, None]), "the accelerometer felt a motion"),
        (replace(LEVEL, accel=LEVEL.accel + 3827.0), "the accelerometer is at its limit (axis z)"),
        (reading(np.array([0.7, 0.0, 0.7])), "no side is up: the sensor reads x +0.70, y "),
        (reading(np.array([0.0, 0.0, 0.5])), "no side is up"),
        (reading(np.array([0.0, 0.0, 2.0])), "no side is up"),
    ],
)
def test_a_reading_that_is_no_pose_is_refused(taken: VectorReading, said: str | None) -> None:
    found = sides.refusal(POSES[0], taken, GYRO, ACCEL, {})
    assert found is None if said is None else (found or "").startswith(said)


def taken_as(names: list[str], mounting: FloatArray) -> dict[str, tuple[Pose, FloatArray]]:
    return {name: (BY_NAME[name], mounting @ up(BY_NAME[name])) for name in names}


@pytest.mark.parametrize("number", range(24))
def test_only_the_right_side_is_taken_however_it_is_mounted(number: int) -> None:
    """Of the six sides each pose takes the one that it is, where the earlier ones say which that is."""
    mounting, names = rotations()[number], list(BY_NAME)
    can_be = {
        0: set(names),  # the first one may be any side
        1: {"upside down"},
        2: {"left side up", "right side up", "front up", "front down"},
        3: {"right side up"},
        4: {"front up"},  # the third axis follows from the other two
        5: {"front down"},
    }
    for index, pose in enumerate(POSES):
        earlier = taken_as(names[:index], mounting)
        taken = {
            name for name in names
            if sides.refusal(pose, reading(mounting @ up(BY_NAME[name])), GYRO, ACCEL, earlier) is None
        }  # fmt: skip
        assert taken == can_be[index], pose.name


@pytest.mark.parametrize(
    ("pose", "held", "earlier", "said"),
    [
        ("upside down", "level", ["level"], "the same as in the pose 'level'"),
        ("upside down", "front up", ["level"], "not the opposite of the pose 'level'"),
        ("left side up", "upside down", ["level"], "the opposite of the pose 'level'"),
        ("front up", "front down", ["level", "left side up"], "the other way up, or a side before was taken for"),
    ],
)
def test_a_wrong_side_says_which_it_is(pose: str, held: str, earlier: list[str], said: str) -> None:
    seen = taken_as(earlier, np.eye(3))
    assert said in (sides.refusal(BY_NAME[pose], reading(up(BY_NAME[held])), GYRO, ACCEL, seen) or "")
