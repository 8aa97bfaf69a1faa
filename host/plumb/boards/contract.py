"""The interface of a board, which is anything that runs the control step, with its inputs and outputs."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, Self, runtime_checkable

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from plumb.contract.parameters import Changes, ControlParams
    from plumb.f103.machine import Machine
    from plumb.link.session import Session
    from plumb.spec.records import Words

RawCounts = npt.NDArray[np.int16]
"""Raw counts of every step, shape (steps, 6); a system uses the first few columns."""
Setpoints = npt.NDArray[np.int32]
"""Setpoint of every step, shape (steps,), in the unit that the system declares; of an angle a full turn is 2**32."""


@dataclass(frozen=True)
class Answer:
    """Output of a run on a board.

    digests: CRC-32 of each step's words, shape (steps,). words: the words of all steps from boards that give them
    (fixed, native, qemu), else None: over a link only digests are sent, and `words_of_step` gets the words of one step.
    unverified_from: first step whose digest or raw counts were lost on the link, else None; why: the reason, when it is
    another one than a loss on the link. compared: the steps of which all that the comparison needs was received; None:
    those before `unverified_from`.
    """

    digests: npt.NDArray[np.uint32]
    words: Words | None = None
    unverified_from: int | None = None
    why: str = ""
    compared: npt.NDArray[np.bool_] | None = None

    def received(self, expected: npt.NDArray[np.uint32]) -> npt.NDArray[np.uint32]:
        """The digests, with the expected one, of shape (steps,), for each step that cannot be compared."""
        if self.compared is not None:
            return np.where(self.compared, self.digests, expected)
        if self.unverified_from is not None:
            return np.concatenate([self.digests[: self.unverified_from], expected[self.unverified_from :]])
        return self.digests


@dataclass(frozen=True)
class StepOutput:
    """Digest and outputs of one step. outputs: the words that the system lists in OUTPUTS, by name."""

    digest: int
    outputs: dict[str, int]


class Stepper(Protocol):
    """A run in lockstep, one sample at a time: for closed loops whose plant runs on the host."""

    def step(self, raw: tuple[int, ...], setpoint: int) -> StepOutput: ...

    def digests(self, raw: RawCounts) -> list[int]:
        """Run a step for each sample with setpoint 0; the digests of these steps."""
        ...


class StepBoard(Protocol):
    """Anything that runs the control step: fixed, native, qemu, virtual, and a board behind a link. A context manager:
    leaving it closes the link."""

    name: str

    @abstractmethod
    def run_injected(self, params: ControlParams, raw: RawCounts, setpoint: Setpoints) -> Answer:
        """Reset the controller, then run every step in lockstep."""

    @abstractmethod
    def words_of_step(self, params: ControlParams, raw: RawCounts, setpoint: Setpoints, step: int) -> dict[str, int]:
        """Reset the controller, run the steps 0 to `step`, and return every word of step `step` by name."""

    @abstractmethod
    def stepper(self, params: ControlParams) -> Stepper:
        """Reset the controller, and return a run that the caller paces."""

    def close(self) -> None:
        """Close the link, if there is one."""
        return None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


@runtime_checkable
class GivesWordsOfSteps(Protocol):
    """A board whose `run_injected` returns only digests, and which returns the words of some steps on request."""

    def words_of_steps(
        self, params: ControlParams, raw: RawCounts, setpoint: Setpoints, first: int, end: int
    ) -> Words | None:
        """Reset the controller, run the steps 0 to `end` - 1, and return the words from step `first` on; None when the
        board cannot give them."""


@runtime_checkable
class ChangesParameters(Protocol):
    """A board that takes other parameters in the middle of a run whose samples the host sends."""

    def run_changed(self, params: ControlParams, changes: Changes, raw: RawCounts, setpoint: Setpoints) -> Answer:
        """Reset the controller, then run every step, from the step of each change on with its parameters."""


@runtime_checkable
class KeepsTime(Protocol):
    """A board whose real-time run the host can keep up with, so that changed parameters take effect at the intended
    step."""

    def run_paced(self, params: ControlParams, changes: Changes, raw: RawCounts, setpoint: Setpoints) -> Answer:
        """As `run_changed`, in real time: unverified from the first step whose inputs the board does not confirm."""


class PartRunner(Protocol):
    """A run in lockstep whose samples come in parts."""

    def run(self, raw: RawCounts, setpoint: Setpoints) -> npt.NDArray[np.uint32]:
        """Run the next steps; their digests."""

    def change(self, params: ControlParams) -> None:
        """Use other parameters from the next step on. Only boards that are `ChangesParameters` support it."""

    def end(self) -> None:
        """End the run."""


@runtime_checkable
class RunsInParts(Protocol):
    """A board that does not need all samples of a run at once."""

    def part_runner(self, params: ControlParams) -> PartRunner:
        """Reset the controller, and return a run."""


@runtime_checkable
class SimulatedBoard(StepBoard, Protocol):
    """A board whose chip is simulated in this process: its pins are accessible, its reset pin included."""

    @property
    def machine(self) -> Machine:
        """The chip."""

    session: Session
    """The host's conversation with it, until the next restart or reconnect."""

    def hold(self, system: str) -> Session:
        """Make sure that the image has the system, where the board chooses its image by itself; the chip may be another
        one afterwards."""

    def restart(self) -> Session:
        """Pull the reset pin and connect again; the board then uses its saved parameters."""

    def reconnect(self) -> Session:
        """Connect anew, after a reset by other means."""
