"""Tasks of a board other than the steps of one set of parameters, each with a record of its own.

retune        the record of every step, of a run whose live parameters change between two steps
plausibility  of every step, what plumb_plausibility_step knows after it
refusal       of every table of parameters, whether the core takes it
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from plumb.spec.records import PLAUSIBILITY, RECORDS, VALIDITY

if TYPE_CHECKING:
    from plumb.contract.parameters import Changes, ControlParams

KINDS = ("retune", "plausibility", "refusal")


@dataclass(frozen=True)
class Task:
    """params: of the first step. raw, setpoint: of every step; of a refusal one row for each table, all 0. changes: of
    a retune. tables: of a refusal. unit_turn2_q56: of a plausibility, the value of 2^32 lsb of variance, 0: unknown."""

    kind: str
    params: ControlParams
    raw: npt.NDArray[np.int16]
    setpoint: npt.NDArray[np.int32]
    changes: Changes = ()
    tables: Sequence[ControlParams] = field(default_factory=tuple)
    unit_turn2_q56: int = 0

    @property
    def record(self) -> np.dtype[np.void]:
        """The words of a step, or of a table."""
        return {"plausibility": PLAUSIBILITY, "refusal": VALIDITY}.get(self.kind, RECORDS[self.params.system])
