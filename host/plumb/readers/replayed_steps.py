"""The records of a recorded run's steps, calculated from its raw counts by the C core.

A link carries a few words of a step; a log that holds the raw counts from the beginning says all of them. The digests
of the recording say that they are what the board had.
"""

from __future__ import annotations

import numpy as np

from plumb.boards.native import core as native_core
from plumb.contract.parameters import ControlParams
from plumb.contract.run_fixed import check_inputs
from plumb.errors import UsageError
from plumb.readers.log_replay import RecordedRun
from plumb.readers.recorded_digests import pieces_between
from plumb.readers.run_parts import Steps
from plumb.spec.records import Words


class ReplayedSteps:
    """Call `words` with the parts of a run in order, from its first step on.

    known: number of steps from the first on that can be calculated: up to the first whose inputs are not known, or
    whose digest is another one than the recording's; 0 for a system that the C core does not have. possible: whether it
    was not 0 at the beginning.
    """

    def __init__(self, recorded: RecordedRun) -> None:
        self.known, self._system, self._left = recorded.known, recorded.system, list(recorded.changes)
        self._core: native_core.Controller | None = None
        try:
            self._core = native_core.Controller(recorded.used.params) if self.known else None
        except UsageError:
            self.known = 0
        self.possible = self.known > 0

    def words(self, part: Steps) -> Words | None:
        """The records of the first steps of a part; None when none is known."""
        count = min(len(part), self.known - part.first)
        if count <= 0 or self._core is None:
            return None
        known = part.cut(count)
        counts, setpoints = check_inputs(self._system, known.raw, known.setpoint)
        records = []
        for piece in pieces_between(known, self._left):
            if isinstance(piece, ControlParams):
                self._core.retune(piece)
            else:
                records.append(self._core.run(counts[piece], setpoints[piece]).record)
        words = Words(np.concatenate(records))
        differs = np.flatnonzero(known.digest_known & (words.digests() != known.digest))
        if not len(differs):
            return words
        self.known = known.first + int(differs[0])
        return Words(words.record[: differs[0]]) if differs[0] else None
