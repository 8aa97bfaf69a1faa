"""Calibration from poses: what is found, and every reading that is refused with its reason."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from plumb.errors import UsageError
from plumb.spec.tuning import Channel
from plumb.systems.quad.poses import POSES, TURN
from plumb.tuning import pose_calibration as calibration
from plumb.tuning.pose_calibration import Pose, Reading

NOMINAL = {
    "gyro": Channel(1676.0, 1.2, 1401, 1951),
    "accel": Channel(2048.0, 0.001, 409, 3687),
    "accel_up": Channel(2048.0, 0.001, 409, 3687),
}
TRUE = {
    "gyro": Channel(1680.0, -1.3, 1401, 1951),  # mounted the other way round
    "accel": Channel(2100.0, 0.00103, 409, 3687),
    "accel_up": Channel(2010.0, -0.00097, 409, 3687),
}
UNITS = {"gyro": "turn/s", "accel": "g", "accel_up": "g"}
BY_NAME = {pose.name: pose for pose in POSES}
TILTS_DEG = dict(zip(BY_NAME, (0.0, 90.0, 180.0, 270.0), strict=True))


def reading(tilt_deg: float, rate_dps: float = 0.0, seconds: float = 1.0, **changes: object) -> Reading:
    tilt_rad = math.radians(tilt_deg)
    felt = {"gyro": rate_dps, "accel": math.sin(tilt_rad), "accel_up": math.cos(tilt_rad)}
    mean = {group: one / TRUE[group].unit_per_count + TRUE[group].zero_counts for group, one in felt.items()}
    still = dict.fromkeys(mean, 0.8)
    taken = Reading(mean, still, dict.fromkeys(mean, 0.0), 100, 100, seconds)
    return replace(taken, **changes)  # type: ignore[arg-type]


READINGS = {pose.name: reading(TILTS_DEG[pose.name]) for pose in POSES}


def refused(pose: str, taken: Reading, **earlier: Reading) -> str:
    seen = {name: (BY_NAME[name], one) for name, one in earlier.items()}
    return calibration.refusal(BY_NAME[pose], taken, NOMINAL, "gyro", seen) or ""


def test_gains_zeros_and_signs_are_found() -> None:
    found = calibration.accelerometer(POSES, READINGS, NOMINAL)
    for group in ("accel", "accel_up"):
        assert found[group].unit_per_count == pytest.approx(TRUE[group].unit_per_count)
        assert found[group].zero_counts == pytest.approx(TRUE[group].zero_counts)
        assert (found[group].min_counts, found[group].max_counts) == (409, 3687)
    angle_deg = calibration.turned_deg(TURN, READINGS["level"], READINGS["motor 0 up"], {**NOMINAL, **found})
    assert angle_deg == pytest.approx(90.0)
    moving = reading(0.0, rate_dps=18.0, seconds=5.0)
    gyro = calibration.gyroscope(TURN, 1680.0, moving, angle_deg, NOMINAL["gyro"])
    assert gyro.unit_per_count == pytest.approx(-1.3)
    whole = {**found, "gyro": gyro}
    after = calibration.residual(POSES, READINGS, whole, TURN, moving, 90.0)
    before = calibration.residual(POSES, READINGS, NOMINAL, TURN, moving, 90.0)
    assert max(after.norm_g, after.pose_deg, abs(after.bias_dps), abs(after.turn_deg)) < 1e-4
    # As TRUE is made: scales off by more than 2 %, and the gyro the wrong way round, -180 deg for 90 and more.
    assert before.norm_g > 0.02 and before.bias_dps == pytest.approx(4.8) and before.turn_deg < -150.0
    words = calibration.words(whole, UNITS)
    again = calibration.channels_of(words, UNITS)
    # A word keeps a gain to 1e-4 (its last bit).
    assert again["accel_up"].unit_per_count == pytest.approx(-0.00097, rel=1e-4) and words["gyro.gain"] < 0


@pytest.mark.parametrize("pose", BY_NAME)
def test_a_good_reading_is_taken_whatever_the_signs(pose: str) -> None:
    assert refused(pose, READINGS[pose]) == ""
    assert refused(pose, reading(TILTS_DEG[pose] + 12.0)) == ""  # before the gains are known, that much may be theirs


@pytest.mark.parametrize(
    ("taken", "said"),
    [
        (reading(0.0, samples=90), "only 90 of 100 samples came"),
        (reading(0.0, samples=0, expected=0), "only 0 of 0 samples came"),
        (reading(0.0, deviation={"gyro": 6.0, "accel": 1.0, "accel_up": 1.0}), "the gyro felt a motion"),
        (reading(0.0, deviation={"gyro": 1.0, "accel": 60.0, "accel_up": 1.0}), "accel felt a motion"),
        (reading(0.0, drift={"gyro": 0.0, "accel": 0.0, "accel_up": -25.0}), "accel_up felt a motion"),
        (reading(0.0, mean={"gyro": 1680.0, "accel": 4.0, "accel_up": 979.0}), "accel reads 4 counts, outside 409 to"),
        (reading(90.0), "this is another pose: it reads accel +1.02 g, accel_up -0.04 g"),
        (reading(40.0), "this is another pose"),
    ],
)
def test_a_bad_reading_is_refused_with_the_reason(taken: Reading, said: str) -> None:
    assert refused("level", taken).startswith(said)


def test_the_opposite_pose_has_to_be_the_opposite() -> None:
    seen = {"level": reading(0.0)}
    assert "the same as in the pose 'level': turn it" in refused("upside down", reading(4.0), **seen)
    assert refused("upside down", reading(180.0), **seen) == ""
    assert refused("level", reading(1.0), **seen) == ""  # the same pose once more


def test_a_pose_that_was_held_badly_is_named() -> None:
    crooked = {**READINGS, "motor 0 up": reading(81.0)}
    channels = {**NOMINAL, **calibration.accelerometer(POSES, crooked, NOMINAL)}
    worst = calibration.worst_pose(POSES, crooked, channels)
    # It was held 9 deg off; the fit takes some of that for scale and zero of its axis.
    assert worst is not None and worst[0].name == "motor 0 up" and worst[1] == pytest.approx(9.0, abs=1.5)
    channels = {**NOMINAL, **calibration.accelerometer(POSES, READINGS, NOMINAL)}
    assert calibration.worst_pose(POSES, READINGS, channels) is None


def test_a_sensor_of_another_scale_is_refused() -> None:
    other = {**NOMINAL, "accel": replace(NOMINAL["accel"], unit_per_count=0.002)}
    with pytest.raises(UsageError, match=r"accel: a count is 0\.5. times what the parameters say"):
        calibration.accelerometer(POSES, READINGS, other)


@pytest.mark.parametrize(
    ("rate_dps", "angle_deg", "said"),
    [
        (4.0, 20.0, "it turned by 20 degrees"),
        (0.5, 90.0, "the gyro hardly felt a turn of 90 degrees"),
        (60.0, 90.0, "a count is 0.3"),
    ],
)
def test_a_bad_turn_is_refused(rate_dps: float, angle_deg: float, said: str) -> None:
    with pytest.raises(UsageError) as caught:
        calibration.gyroscope(TURN, 1680.0, reading(0.0, rate_dps, seconds=5.0), angle_deg, NOMINAL["gyro"])
    assert said in str(caught.value)


def test_a_gain_of_0_names_what_to_do() -> None:
    words = {**calibration.words(NOMINAL, UNITS), "accel.gain": 0}
    with pytest.raises(UsageError, match=r"accel\.gain is 0: load a tuning first"):
        calibration.channels_of(words, UNITS)


def test_six_poses_for_three_axes() -> None:
    """The poses are a declaration: a system with three axes has six, and each axis gets its gain from two of them."""
    axes = ("x", "y", "z")
    poses = [
        Pose(f"{sign}{axis}", "", {one: (1.0 if sign == "+" else -1.0) * (one == axis) for one in axes})
        for axis in axes
        for sign in "+-"
    ]
    true = {axis: Channel(10.0 * number, 0.004 * (1 + number), -9999, 9999) for number, axis in enumerate(axes, 1)}
    nominal = {axis: replace(channel, zero_counts=0.0) for axis, channel in true.items()}
    taken = {
        pose.name: Reading(
            {axis: pose.up_g[axis] / true[axis].unit_per_count + true[axis].zero_counts for axis in axes},
            dict.fromkeys(axes, 0.0), dict.fromkeys(axes, 0.0), 9, 9, 1.0,
        )
        for pose in poses
    }  # fmt: skip
    found = calibration.accelerometer(poses, taken, nominal)
    assert {axis: round(channel.zero_counts, 6) for axis, channel in found.items()} == {"x": 10.0, "y": 20.0, "z": 30.0}
