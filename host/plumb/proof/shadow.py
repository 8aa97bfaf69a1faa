"""Run the integer model in step with a live board, on the raw counts that the board streams.

When a digest differs and no frame was lost, the board is wrong: the run ends and is repeated in lockstep with every
word of that step selected, which gives the first word that differs. After a lost frame the verdict is "unverified" from
there on: neither pass nor fail. Parameters that are committed during the run are given to the model at the step that
the board names; a table that the host does not know is read from the board (`plumb.link.used_tables`).
"""

from __future__ import annotations

from array import array
from collections.abc import Mapping

import numpy as np

from plumb.contract import run_fixed
from plumb.contract.parameters import Change, ControlParams
from plumb.link.realtime import Capture
from plumb.link.session import Session
from plumb.proof.compare import Divergence, divergence_at


class Shadow:
    """The model of one run. steps: number compared so far, including those of `before`, the shadow of the previous
    run. changes: the parameters that the run got on its way, each with its first step. keeps: whether the capture keeps
    what was compared, and `words` the model's words of each step that was equal, by step; the caller removes both."""

    def __init__(self, params: ControlParams, before: Shadow | None = None, *, keeps: bool = False) -> None:
        self.params = params
        self.words: dict[int, Mapping[str, int]] = {}
        self._keeps = keeps
        self.changes: list[Change] = []
        self.steps: int = before.steps if before else 0
        self.unverified_runs: int = before.unverified_runs if before else 0
        self.unverified_from: int | None = None
        self.unverified_why = "a frame was lost"
        self.divergence: Divergence | None = None
        self._model = run_fixed.Controller(params)
        self._next = self._taken = 0
        self._raw, self._setpoints = array("h"), array("i")
        self._setpoint = 0
        self._lost_before: int | None = None

    @property
    def verdict(self) -> str:
        if self.divergence is not None:
            return "fail"
        return "pass" if self.steps and not self.unverified_runs else "unverified"

    def follow(self, capture: Capture, lost: int) -> None:
        """Compare every complete step, that is, one whose successor has begun to arrive. lost: frames missing so
        far."""
        if self._lost_before is None:
            self._lost_before = lost
        while self.divergence is None and self.unverified_from is None and self._next + 1 < capture.steps:
            step = self._next
            if not self._parameters_known(capture, step):
                return
            raw, digest = capture.raw.get(step), capture.digest.get(step)
            if not self._keeps:
                capture.raw.pop(step, None), capture.digest.pop(step, None)
            if raw is None or digest is None:
                self._give_up(step)
                return
            for first, value in capture.setpoints.changes:
                if first == step:
                    self._setpoint = value
            words = self._model.step(raw, self._setpoint)
            self._raw.extend(raw)
            self._setpoints.append(self._setpoint)
            if self._model.digest() != digest:
                if lost != self._lost_before:  # a setpoint may be among the lost frames
                    self._give_up(step)
                    return
                self.divergence = Divergence(step, 0, "digest", self._model.digest(), digest)
                return
            if self._keeps:
                self.words[step] = words
            self._next += 1
            self.steps += 1

    def _parameters_known(self, capture: Capture, step: int) -> bool:
        """Give the model the parameters of a step. False when they are not known: the step waits until the board has
        sent its table, or is unverified."""
        tables = capture.tables
        while self._taken < len(tables.changes) and tables.changes[self._taken].step <= step:
            change = tables.changes[self._taken]
            if change.words is None and not tables.lost(change):
                capture.ask_for_table()
                return False
            params = change.params(self.params)
            if params is None or change.step < step:
                self.unverified_why = change.why_unknown
                self._give_up(step)
                return False
            self._model.retune(params)
            self.changes.append(Change(step, params))
            self._taken += 1
        return True

    def _give_up(self, step: int) -> None:
        self.unverified_from = step
        self.unverified_runs += 1

    def locate(self, session: Session) -> None:
        """Run again in lockstep up to the step that differed, and find the first word that differs. A run whose
        parameters changed before is not repeated, because a board does not change them in lockstep."""
        from plumb.boards.link import LinkBoard

        assert self.divergence is not None
        if self.changes:
            return
        step = self.divergence.step
        raw = np.array(self._raw, np.int16).reshape(len(self._setpoints), -1)
        setpoints = np.array(self._setpoints, np.int32)
        expected = run_fixed.run_control(self.params, raw, setpoints)
        actual = LinkBoard("board", session).words_of_step(self.params, raw, setpoints, step)
        self.divergence = divergence_at(step, expected, actual, self.divergence.actual)
