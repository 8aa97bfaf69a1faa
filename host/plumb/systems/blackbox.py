"""Contract of blackbox.py: a system whose steps can be written in the columns of blackbox_decode, for the viewers of
flight controllers' logs (`plumb export --format bbl-csv`).

The axes are those of such logs: x to the front, y to the left, z up; a positive rate lowers the right side, lowers the
nose, turns to the left seen from above.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from plumb.contract.parameters import ControlParams
from plumb.spec.records import Words
from plumb.spec.system_parts import Part

Cells = npt.NDArray[np.floating[Any]] | npt.NDArray[np.int64] | npt.NDArray[np.str_]  # Any: numpy's own width
PID_UNITS = 1000.0
"""axisP, axisI, axisD: units in the full command of a motor."""
STICK_UNITS, THROTTLE_UNITS, THROTTLE_LOW = 500.0, 1000.0, 1000.0
"""rcCommand: a full stick, the whole way of the throttle, and its low end."""
COLUMNS = (
    "loopIteration", "time (us)",
    *(f"axis{part}[{axis}]" for part in "PIDF" for axis in range(3)),
    *(f"rcCommand[{axis}]" for axis in range(4)), *(f"setpoint[{axis}]" for axis in range(4)),
    *(f"{name}[{axis}]" for name in ("gyroADC", "gyroUnfilt", "accSmooth") for axis in range(3)),
    *(f"motor[{motor}]" for motor in range(8)),
    "flightModeFlags (flags)", "stateFlags (flags)", "failsafePhase (flags)", "rxSignalReceived",
    "rxFlightChannelsValid",
)  # fmt: skip
"""All that may be written, in their order."""


class Blackbox(Protocol):
    """blackbox.py of a system."""

    def columns(self, words: Words, before: Words, params: ControlParams, /) -> Mapping[str, Cells]:
        """Columns by name, (n,), of consecutive steps. before: the step before each of them, zeros before the first one
        of a run; params: those that the steps used. Number, time and raw sensors are written for every system."""


BLACKBOX = Part[Blackbox]("blackbox", Blackbox, without="a blackbox viewer has no columns for what it does")
