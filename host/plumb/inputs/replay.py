"""Recordings of real sensors as inputs of a run: what `plumb replay` and `plumb.Recording.replay` share.

The module `replay` of a system's folder makes inputs of a recording.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from plumb import systems
from plumb.boards import Board
from plumb.proof import runs
from plumb.proof.runs import RunInputs
from plumb.proof.scenario_run import ScenarioRun
from plumb.spec.system_parts import Part
from plumb.tuning.quantise import ControlParams


@dataclass(frozen=True)
class ReplayRequest:
    """A recording to be replayed. axis: x, y or z, of systems of one axis. period_us: None, the recording's own or the
    system's. seconds: only the first; None: all of it."""

    file: Path
    axis: str = "x"
    period_us: int | None = None
    seconds: float | None = None


class Replayed(Protocol):
    """replay.py of a system: recordings of real sensors as inputs of a run."""

    def inputs_of(self, request: ReplayRequest, /) -> tuple[RunInputs, ControlParams, Mapping[str, object]]:
        """Inputs, parameters, and the heading of the summary; "warnings" in it: sentences that the user should read."""


REPLAY = Part[Replayed]("replay", Replayed, without="no recording can be made its inputs")


@dataclass(frozen=True)
class Replay:
    """Inputs that a recording was made into, for any board."""

    system: str
    inputs: RunInputs
    params: ControlParams
    heading: Mapping[str, object]

    @property
    def warnings(self) -> list[str]:
        """What the user should know before the figures are believed, a sentence each."""
        said = self.heading.get("warnings", [])
        assert isinstance(said, list)
        return said

    def run(self, board: Board, name: str, link: str | None) -> ScenarioRun:
        """Run the inputs in lockstep, and compare every step with the model. name, link: of the board, for the
        summary."""
        result = runs.open_loop(board, self.inputs, self.params)
        heading = {
            "system": self.system,
            **self.heading,
            "loop": "open",
            "board": name,
            "link": link,
            "seed": None,
            "scored_steps": int(self.inputs.scored.sum()),
            "warnings": self.warnings,
        }
        return ScenarioRun(result, heading)


def prepare(system: str, request: ReplayRequest) -> Replay:
    """Raises UsageError for a system that makes no inputs of recordings, or a file that cannot be used."""
    return Replay(system, *systems.load(system, REPLAY).inputs_of(request))
