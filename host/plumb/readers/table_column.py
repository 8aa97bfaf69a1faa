"""One column of the table of a recorded run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from plumb.spec.arrays import BoolArray

Values = npt.NDArray[np.float64 | np.int64 | np.int16 | np.uint32]


@dataclass(frozen=True)
class Column:
    """One column, (n,). known: where the value is known; None: everywhere. frame: the telemetry frame that carries it,
    or the group that it stands in. texts: meaning of each value, of a column that is written in words. replaces:
    names of columns that say the same in integers."""

    name: str
    unit: str
    values: Values
    known: BoolArray | None = None
    frame: str = ""
    texts: Mapping[int, str] = field(default_factory=dict)
    replaces: tuple[str, ...] = ()
