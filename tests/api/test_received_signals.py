"""Signals from a link or a log: the names of the frames, in either unit, as keys and as attributes."""

from __future__ import annotations

import math

import numpy as np
import pytest

from plumb.api.signals import ReceivedArrays, ReceivedStep

STEP = ReceivedStep(
    "quad", {"tilt_deg": 90.0, "bias_dps": 180.0, "pulse_0_us": 1500.0, "command": 0.25, "accel_z_g": 1.0}
)


def test_a_signal_has_one_name_a_unit_as_key_and_as_attribute() -> None:
    expected = {"tilt_rad": math.pi / 2, "bias_radps": math.pi, "pulse_0_s": 1.5e-3, "accel_z_mps2": 9.80665}
    for name, value in {**expected, **dict(STEP)}.items():
        assert name in STEP and STEP[name] == getattr(STEP, name) == pytest.approx(value, rel=1e-15)
    assert list(STEP) == ["tilt_deg", "bias_dps", "pulse_0_us", "command", "accel_z_g"] and len(STEP) == 5
    assert dict(STEP) == STEP and {"tilt_deg", "tilt_rad"} <= set(dir(STEP))


def test_a_wrong_name_is_reported_with_the_nearest() -> None:
    with pytest.raises(KeyError, match=r"quad has no signal 'tilt_degs' \(did you mean tilt_deg\?\)"):
        STEP["tilt_degs"]
    with pytest.raises(AttributeError, match=r"did you mean tilt_rad\?"):
        _ = STEP.tilt_rads
    assert STEP.get("attitude_w") is None and not hasattr(STEP, "quaternion")


def test_the_attitude_of_the_frames_has_its_names_and_angles() -> None:
    """A yaw of 60 deg, then a roll of 40 deg."""
    yaw, roll = np.radians([60.0, 0.0]) / 2.0, np.radians([40.0, 0.0]) / 2.0
    w, x = np.cos(yaw) * np.cos(roll), np.cos(yaw) * np.sin(roll)
    y, z = np.sin(yaw) * np.sin(roll), np.sin(yaw) * np.cos(roll)
    run = ReceivedArrays("attitude", {"flags": np.zeros(2), "w": w, "x": x, "y": y, "z": z})
    assert np.array_equal(run.attitude_w, w)
    assert np.array_equal(run.quaternion, np.stack([w, x, y, z], axis=1))
    for name, expected in (("roll_deg", 40.0), ("pitch_deg", 0.0), ("yaw_deg", 60.0), ("yaw_rad", math.pi / 3)):
        assert run[name] == pytest.approx([expected, 0.0], abs=1e-12)
    assert ReceivedStep("attitude", {"w": 1.0, "x": 0.0, "y": 0.0, "z": 0.0}).roll_deg == 0.0
    lost = ReceivedStep("attitude", {"w": 1.0, "x": 0.0, "z": 0.0})
    assert "roll_deg" not in lost and "attitude_w" in lost


def test_lists_of_signals_can_be_printed() -> None:
    assert repr(ReceivedStep("quad", {"tilt_deg": 1.0})) == "{'tilt_deg': 1.0}"
