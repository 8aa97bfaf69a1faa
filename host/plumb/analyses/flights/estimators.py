"""Estimators of the vertical for many flights side by side, a step of all at a time.

VQF and BasicVQF run as the package ships them, an object a run. Mahony is our own lines with the settings of
Betaflight (src/main/flight/imu.c, imu_dcm_kp 2500 and imu_dcm_ki 0): k_P 0.25, ten times that before take-off, when
the gyro's mean is taken as its bias; the acceleration goes through a low-pass of 10 Hz
(acc_lpf_hz) and counts between 0.9 and 1.1 g. Systems of plumb run in the native core, an instance a run.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from plumb import systems
from plumb.analyses.comparison import published
from plumb.analyses.comparison.contenders import Described
from plumb.errors import UsageError
from plumb.physics.airframe import G_MPS2, Airframe
from plumb.physics.imu import ImuGrade
from plumb.physics.vectors import cross
from plumb.spec import declarations
from plumb.spec.arrays import FloatArray
from plumb.spec.system_parts import Part
from plumb.version import installed

Counts = npt.NDArray[np.int16]


class Flown(Protocol):
    """An estimator of all runs."""

    def step(self, counts: Counts, thrust: FloatArray) -> FloatArray:
        """The vertical in body axes, (runs, 3). counts: (runs, 6); thrust: collective command that the rotors had
        last, 0 to 1, 0 before take-off and after landing, (runs,)."""

    def sigma_deg(self) -> FloatArray | None:
        """Standard deviation of the tilt after the last step, (runs,); None of an estimator that states none."""

    def restarts(self) -> int:
        """How many runs have begun again so far."""


class FlownSystem(Protocol):
    """flight.py of a system: its estimate in flight."""

    @property
    def TUNING_NAME(self) -> str: ...

    def begin(self, grade: ImuGrade, frame: Airframe, period_us: int, runs: int, /) -> Flown:
        """The estimators of so many runs before the first step; one that uses the drag of the rotors takes it as
        `frame.drag_setting_per_s`. Raises UsageError for a period that it cannot have."""


FLIGHT = Part[FlownSystem]("flight", FlownSystem, without="no vehicle is flown on it", place="judging")


@dataclass(frozen=True)
class Estimator(Described):
    """An algorithm that flies. begin: as FlownSystem's."""

    begin: Callable[[ImuGrade, Airframe, int, int], Flown]


def estimators(only: Sequence[str] = ()) -> tuple[Estimator, ...]:
    """VQF, BasicVQF, Mahony, then the systems that fly; only: their names, () for all."""
    rivals = {name: _rival(name) for name in ("VQF", "BasicVQF")}
    settings = "k_P 0.25, k_I 0, 0.9 to 1.1 g, bias of the rest"
    rivals["Mahony"] = Estimator("Mahony", "own lines", settings, published.NOT_PUBLISHED, None, _frameless("Mahony"))
    for name in systems.with_part(FLIGHT.name):
        part, budget = systems.load(name, FLIGHT), declarations.system(name).cycles
        cost = "no budget declared" if budget is None else f"at most {budget} cycles (plumb bench)"
        version = f"plumb {installed().version}"
        rivals[name] = Estimator(name, version, f"tuning {part.TUNING_NAME}", cost, None, part.begin)
    for name in only:
        if name not in rivals:
            raise UsageError(f"no algorithm '{name}' flies; there are {', '.join(rivals)}")
    return tuple(one for name, one in rivals.items() if not only or name in only)


def _rival(name: str) -> Estimator:
    one = next(each for each in published.PUBLISHED if each.name == name)
    limit_dps = one.bias_limit_dps(published.imported(one))
    return Estimator(name, one.origin, one.settings, one.cost, limit_dps, _frameless(name))


def _frameless(name: str) -> Callable[[ImuGrade, Airframe, int, int], Flown]:
    """The algorithm of that name, which asks for no airframe, among those that may."""

    def begin(grade: ImuGrade, _frame: Airframe, period_us: int, runs: int) -> Flown:
        return rival(name, grade, period_us, runs)

    return begin


def rival(name: str, grade: ImuGrade, period_us: int, runs: int) -> Flown:
    """VQF, BasicVQF or Mahony before the first step. Raises UsageError where its package is not installed."""
    if name == "Mahony":
        return _Mahony(grade, period_us, runs)
    return _Vqf(next(each for each in published.PUBLISHED if each.name == name), grade, period_us, runs)


class _Values:
    """Counts as rates in rad/s and accelerations in m/s^2, (runs, 3) each."""

    def __init__(self, grade: ImuGrade) -> None:
        self._radps = np.radians(grade.gyro.unit_per_count)
        self._mps2 = grade.accel.unit_per_count * G_MPS2

    def __call__(self, counts: Counts) -> tuple[FloatArray, FloatArray]:
        values = counts.astype(np.float64)
        return values[:, :3] * self._radps, values[:, 3:] * self._mps2


class _Vqf:
    def __init__(self, one: published.Published, grade: ImuGrade, period_us: int, runs: int) -> None:
        filter_of = getattr(published.imported(one), one.name)
        self._each = [filter_of(period_us * 1e-6) for _ in range(runs)]
        self._values = _Values(grade)

    def step(self, counts: Counts, _thrust: FloatArray) -> FloatArray:
        gyr, acc = self._values(counts)
        quat = np.empty((len(counts), 4))
        for row, one in enumerate(self._each):
            one.update(gyr[row], acc[row])
            quat[row] = one.getQuat6D()
        w, x, y, z = quat.T
        return np.stack([2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)], 1)

    def sigma_deg(self) -> None:
        return None

    def restarts(self) -> int:
        return 0


MAHONY_PER_S, MAHONY_FAST, MAHONY_LOW_G, MAHONY_HIGH_G, MAHONY_PASS_HZ = 0.25, 10.0, 0.9, 1.1, 10.0


class _Mahony:
    """The vertical alone: it turns by the gyro, and by k_P times the cross product towards the acceleration."""

    def __init__(self, grade: ImuGrade, period_us: int, runs: int) -> None:
        self._values, self._period_s = _Values(grade), period_us * 1e-6
        self._up, self._force, self._bias, self._at_rest = *np.zeros((3, 3, runs)), 0

    def step(self, counts: Counts, thrust: FloatArray) -> FloatArray:
        gyr, acc = self._values(counts)
        if not self._at_rest:
            self._force = acc.T / G_MPS2
            self._up = self._force / np.sqrt((self._force**2).sum(axis=0))
        self._force += -np.expm1(-2.0 * np.pi * MAHONY_PASS_HZ * self._period_s) * (acc.T / G_MPS2 - self._force)
        force = self._force
        length = np.sqrt((force * force).sum(axis=0))
        if not thrust.any():
            self._at_rest += 1
            self._bias += (gyr.T - self._bias) / self._at_rest
        counted = (length > MAHONY_LOW_G) & (length < MAHONY_HIGH_G)
        gain = np.where(counted, np.where(thrust > 0.0, 1.0, MAHONY_FAST) * MAHONY_PER_S, 0.0) / np.maximum(length, 0.1)
        turn = self._period_s * (gyr.T - self._bias + gain * cross(force, self._up))
        # A vector that stands still on earth turns against the body. Second order serves fast turns, too.
        first = cross(self._up, turn)
        self._up = self._up + first + 0.5 * cross(first, turn)
        self._up /= np.sqrt((self._up * self._up).sum(axis=0))
        return np.ascontiguousarray(self._up.T)

    def sigma_deg(self) -> None:
        return None

    def restarts(self) -> int:
        return 0
