"""Replay a recording of real sensors on a board, for `plumb replay` and `plumb.Recording.replay`.

The module `replay` of a system's folder converts a recording to the inputs of a run.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, runtime_checkable

from plumb import systems
from plumb.boards.contract import StepBoard
from plumb.contract.parameters import ControlParams
from plumb.proof import runs
from plumb.proof.report import Statement
from plumb.proof.runs import RunInputs
from plumb.proof.scenario_run import ScenarioRun
from plumb.readers import recording
from plumb.readers.recording import Recording
from plumb.spec.system_parts import Part
from plumb.spec.tuning import AnyTuning


@dataclass(frozen=True)
class ReplayRequest:
    """A recording to replay. axis: x, y or z, for one-axis systems. period_us: None for the recording's own or the
    system's. seconds: length of the part from the beginning; None for all of it. decimate: samples of a block, whose
    mean is taken first; 1: none. tuning: None for the one that the system replays with. loaded: the file, where it is
    read already."""

    file: Path
    axis: str = "x"
    period_us: int | None = None
    seconds: float | None = None
    decimate: int = 1
    tuning: AnyTuning | None = None
    loaded: Recording | None = None

    def recording(self) -> Recording:
        """The file as a recording, decimated; raises UsageError for one that cannot be used."""
        return recording.decimated(self.loaded or recording.load(self.file), self.decimate)


UNITS = Statement(
    "origin",
    "the counts were made from units, for an ideal sensor: no proof of what a board did with the recorded motion",
    None,
)
"""Limits of the verdict over a recording in units."""


class Replayed(Protocol):
    """replay.py of a system: converts recordings of real sensors to the inputs of a run."""

    def inputs_of(self, request: ReplayRequest, /) -> tuple[RunInputs, ControlParams, Mapping[str, object]]:
        """Inputs, parameters, and the first entries of the summary; its "warnings" are sentences for the user."""


REPLAY = Part[Replayed]("replay", Replayed, without="no recording can be made its inputs", place="judging")


@runtime_checkable
class ReadsFiles(Protocol):
    """replay.py of a system that reads further kinds of files, which are no recordings of an IMU."""

    def reads_itself(self, path: Path, /) -> bool:
        """Whether this is such a file."""


def reads_itself(system: str, path: Path) -> bool:
    """Whether the system itself reads this file, which then is no recording of an IMU."""
    module = systems.load(system, REPLAY)
    return isinstance(module, ReadsFiles) and module.reads_itself(path)


@dataclass(frozen=True)
class Replay:
    """The inputs of a run from a recording, for any board."""

    system: str
    inputs: RunInputs
    params: ControlParams
    heading: Mapping[str, object]

    @property
    def warnings(self) -> list[str]:
        """Warnings about the validity of the figures, one sentence each."""
        said = self.heading.get("warnings", [])
        assert isinstance(said, list)
        return said

    @property
    def statement(self) -> Statement:
        """Limits of the verdict over this recording."""
        return UNITS

    def run(self, board: StepBoard, name: str, link: str | None) -> ScenarioRun:
        """Run the inputs in lockstep and compare every step with the model. name, link: board and link for the
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
            "proof": False,
            "warnings": self.warnings,
        }
        return ScenarioRun(result, heading)


def prepare(system: str, request: ReplayRequest) -> Replay:
    """Read a recording for a system. Raises UsageError for a system that cannot replay recordings, and for a file that
    cannot be used."""
    return Replay(system, *systems.load(system, REPLAY).inputs_of(request))
