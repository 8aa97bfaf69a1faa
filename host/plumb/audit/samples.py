"""The arrays that an audit sees."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from plumb.errors import UsageError
from plumb.spec.arrays import BoolArray, FloatArray

Rows = npt.NDArray[np.intp] | BoolArray


@dataclass(frozen=True)
class Samples:
    """time_s (N,); gyr_dps (N, 3); acc_g (N, 3); ref_quat (N, 4) w, x, y, z or None; mag (N, 3) in any unit or None;
    movement (N,) or None. Units and names are what the file says, which the audit doubts."""

    time_s: FloatArray
    gyr_dps: FloatArray
    acc_g: FloatArray
    ref_quat: FloatArray | None = None
    mag: FloatArray | None = None
    movement: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.time_s)

    def rows(self, kept: Rows) -> Samples:
        """These rows alone."""
        return Samples(
            self.time_s[kept],
            self.gyr_dps[kept],
            self.acc_g[kept],
            *(None if one is None else one[kept] for one in (self.ref_quat, self.mag, self.movement)),
        )

    def with_time(self, time_s: FloatArray) -> Samples:
        return replace(self, time_s=time_s)

    @property
    def step_s(self) -> float:
        """Median of the steps of time that go forward; NaN for none."""
        steps = np.diff(self.time_s)
        forward = steps[steps > 0.0]
        return float(np.median(forward)) if len(forward) else float("nan")

    @property
    def columns(self) -> dict[str, FloatArray]:
        """As `recording_files.read` returns them."""
        found = {"time_s": self.time_s, "gyr": self.gyr_dps, "acc": self.acc_g}
        for name in ("ref_quat", "mag", "movement"):
            values = getattr(self, name)
            if values is not None:
                found[name] = values
        return found


def of_columns(name: str, columns: Mapping[str, FloatArray]) -> Samples:
    """Columns as `recording_files.read` returns them; raises UsageError for shapes that do not fit, and for fewer than
    two samples. name: of the file."""
    time_s, gyr, acc = columns["time_s"], columns["gyr"], columns["acc"]
    n = len(time_s) if time_s.ndim == 1 else -1
    if n in (0, 1):
        raise UsageError(f"{name} has {n} sample{'s' * (n == 0)}: an audit needs two, and tells more from a minute")
    if n < 2 or gyr.shape != (n, 3) or acc.shape != (n, 3):
        raise UsageError(f"{name}: gyr {gyr.shape} and acc {acc.shape} are not (N, 3) beside {max(n, 0)} time stamps")
    shapes = {"ref_quat": (n, 4), "mag": (n, 3), "movement": (n,)}
    for column, shape in shapes.items():
        if column in columns and columns[column].shape != shape:
            raise UsageError(f"{name}: {column} {columns[column].shape} is not {shape}")
    return Samples(time_s, gyr, acc, *(columns.get(column) for column in shapes))
