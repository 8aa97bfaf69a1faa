"""`attitude` in flight, for `plumb compare --flights`: the integers of the native core, an instance a run."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from plumb.boards.native import core as native_core
from plumb.contract.parameters import quantise
from plumb.physics.airframe import Airframe
from plumb.physics.imu import ImuGrade
from plumb.spec import declarations
from plumb.spec.arrays import FloatArray
from plumb.spec.records import Words
from plumb.systems.attitude import scenarios
from plumb.systems.attitude.settings import Aid

TUNING_NAME = "vehicle"
FULL_Q15 = 32767
"""The setpoint for full thrust."""
RESTARTED = "RESTARTED"


class Runs:
    """The estimators of all runs, which know the drag of the rotors and every thrust command."""

    def __init__(self, grade: ImuGrade, frame: Airframe, period_us: int, runs: int) -> None:
        system = declarations.system("attitude")
        tuning = replace(
            scenarios.TUNINGS[TUNING_NAME],
            period_us=period_us,
            gyro=grade.gyro,
            accel=grade.accel,
            aid=Aid(drag_per_s=frame.drag_setting_per_s, hover=frame.hover_command),
        )
        self._core = native_core.Controllers(quantise(tuning), runs)
        flags = [flag.name for flag in system.flags]
        self._restarted = 1 << flags.index(RESTARTED) if RESTARTED in flags else 0
        self._again = np.zeros(runs, np.bool_)
        self._words: Words | None = None

    def step(self, counts: npt.NDArray[np.int16], thrust: FloatArray) -> FloatArray:
        self._words = words = self._core.step(counts, np.rint(FULL_Q15 * thrust).astype(np.int32))
        self._again |= (words["flags"] & self._restarted) != 0
        return np.stack([words[f"up_q30_{axis}"] for axis in range(3)], 1) / 2.0**30

    def sigma_deg(self) -> FloatArray | None:
        assert self._words is not None, "sigma is that of a step"
        return np.degrees(np.sqrt(self._words["tilt_variance_rad2_q32"] / 2.0**32))

    def restarts(self) -> int:
        return int(self._again.sum())


def begin(grade: ImuGrade, frame: Airframe, period_us: int, runs: int) -> Runs:
    """The estimators before the first step."""
    return Runs(grade, frame, period_us, runs)
