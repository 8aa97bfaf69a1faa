"""plumb.Estimator and plumb.load warn of what is surely wrong and of nothing else, once for each recording."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest

import plumb
from plumb.audit import warned
from plumb.spec.arrays import FloatArray
from support.imu_recordings import in_the_hand

G = 9.80665
MIRROR = np.diag([1.0, -1.0, 1.0])


def moved(seconds: float = 25.0) -> tuple[FloatArray, FloatArray]:
    """Arrays of SI of a body in the hand, at 100 Hz."""
    seed = int(np.random.default_rng([2, 5]).integers(1 << 30))
    samples = in_the_hand(seed, 100.0, seconds)
    return np.radians(samples.gyr_dps), samples.acc_g * G


def said(gyr: FloatArray, acc: FloatArray) -> list[str]:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        plumb.Estimator("attitude", period_s=0.01).run(gyr, acc)
    assert all(one.filename == __file__ for one in caught)
    return [str(one.message) for one in caught if one.category is plumb.RecordingWarning]


@pytest.mark.parametrize(
    ("gyr_by", "acc_by", "kind"),
    [
        (np.eye(3), np.eye(3) / G, "accelerometer-units"),
        (np.degrees(np.eye(3)), np.eye(3), "gyro-units"),
        (np.eye(3)[[1, 0, 2]], np.eye(3), "gyro-axes"),
        (MIRROR, MIRROR, "gyro-axes"),
    ],
)
def test_an_estimator_warns_once_of_what_is_surely_wrong(gyr_by: FloatArray, acc_by: FloatArray, kind: str) -> None:
    gyr, acc = moved()
    (one,) = said(gyr @ gyr_by.T, acc @ acc_by.T)
    assert f"{kind}: sure" in one


def test_an_estimator_warns_of_nothing_in_good_arrays() -> None:
    gyr, acc = moved()
    lost = np.arange(len(gyr)) % 7 == 3
    assert said(gyr, acc) == []
    assert said(np.where(lost[:, None], np.nan, gyr), np.where(lost[:, None], np.nan, acc)) == []


def test_good_arrays_pay_for_no_audit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(warned, "audit", lambda samples: pytest.fail("good arrays are audited"))
    assert said(*moved()) == []


def test_short_arrays_are_not_judged() -> None:
    still = np.tile([0.0, 0.0, 1.0], (200, 1)) + 1e-3 * np.random.default_rng(7).standard_normal((200, 3))
    gyr = 1e-3 * np.random.default_rng(8).standard_normal((200, 3))
    assert said(gyr[:199], still[:199]) == [] and len(said(gyr, still)) == 1


def test_load_warns_once_of_what_is_surely_wrong(tmp_path: Path) -> None:
    gyr, acc = moved()
    np.savez(tmp_path / "good.npz", gyr=gyr, acc=acc, rate_hz=100.0)
    np.savez(tmp_path / "bad.npz", gyr=gyr @ MIRROR, acc=acc @ MIRROR, rate_hz=100.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        plumb.load(tmp_path / "good.npz")
    with pytest.warns(plumb.RecordingWarning, match=r"^bad\.npz: gyro-axes: sure") as caught:
        plumb.load(tmp_path / "bad.npz")
    assert len(caught) == 1 and caught[0].filename == __file__


def test_an_estimator_does_not_repeat_what_load_said(tmp_path: Path) -> None:
    gyr, acc = moved()
    np.savez(tmp_path / "bad.npz", gyr=gyr @ MIRROR, acc=acc @ MIRROR, rate_hz=100.0)
    with pytest.warns(plumb.RecordingWarning) as caught:
        loaded = plumb.load(tmp_path / "bad.npz")
    assert len(caught) == 1
    assert said(loaded.gyr_radps, loaded.acc_mps2) == []
    assert said(loaded.gyr_radps[500:], loaded.acc_mps2[500:]) == []
    assert len(said(loaded.gyr_radps, loaded.acc_mps2 / G)) == 1  # a fault of the caller's own
    with pytest.warns(plumb.RecordingWarning):  # who reads the file again is warned again
        plumb.load(tmp_path / "bad.npz")


def test_a_sweep_over_the_same_arrays_warns_once() -> None:
    gyr, acc = moved()
    mirrored = np.concatenate([gyr @ MIRROR, acc @ MIRROR], axis=1)
    assert [len(said(mirrored[:, :3], mirrored[:, 3:])) for _ in range(3)] == [1, 0, 0]
    mirrored[:, 3:] /= G  # in place: another fault of the same recording is said
    (one,) = said(mirrored[:, :3], mirrored[:, 3:])
    assert "accelerometer-units: sure" in one and "gyro-axes" not in one


def test_arrays_that_come_later_are_judged_anew() -> None:
    """Nothing is kept of arrays that are gone, whose place in memory others may take."""
    gyr, acc = moved()
    for _ in range(3):
        assert len(said((gyr @ MIRROR).astype(np.float32), (acc @ MIRROR).astype(np.float32))) == 1
