"""plumb.Estimator and plumb.load warn of what is surely wrong, once a call, and of nothing else."""

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
