"""Boards: everything that can run the C integers, behind one interface.

`native` is the core in process, `qemu` the core as Cortex-M3 code, `virtual` the whole flash image on the simulated
STM32F103; `serial:PORT[@BAUD]` and `can:INTERFACE:CHANNEL[@KBIT]` the same image on silicon, or on a virtual board
served by another process.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Protocol, Self

import numpy as np
import numpy.typing as npt

from plumb.link.endpoint_names import CanName, SerialName, parse_board

if TYPE_CHECKING:
    from plumb.spec.records import Words
    from plumb.tuning.quantise import ControlParams

RawCounts = npt.NDArray[np.int16]
"""Shape (steps, 6): the raw counts of every step; a system uses the first few columns."""
Setpoints = npt.NDArray[np.int32]
"""Shape (steps,): in the unit of the system; quad: binary angles, a full turn is 2**32."""


@dataclass(frozen=True)
class Answer:
    """What a board said of a run.

    digests: shape (steps,), CRC-32 of each step's words. words: the words themselves where the board gives them all
    (native, qemu), else None: a link carries the digests, and single steps are asked for with `words_of_step`.
    unverified_from: first step whose digest or raw counts were lost on the way, else None.
    """

    digests: npt.NDArray[np.uint32]
    words: Words | None = None
    unverified_from: int | None = None


@dataclass(frozen=True)
class StepOutput:
    """One step's digest and what goes to the actuator: words of the record by name, those a system calls OUTPUTS."""

    digest: int
    outputs: dict[str, int]


class Stepper(Protocol):
    """A run in lockstep, one sample at a time: for closed loops whose plant lives on the host."""

    def step(self, raw: tuple[int, ...], setpoint: int) -> StepOutput: ...

    def digests(self, raw: RawCounts) -> list[int]:
        """Samples that are there already, without a setpoint: their digests, whatever else a step puts out."""
        ...


class Board(ABC):
    """Anything that runs the C integers. Use as a context manager: leaving it closes what is open."""

    name: str

    @abstractmethod
    def run_injected(self, params: ControlParams, raw: RawCounts, setpoint: Setpoints) -> Answer:
        """Reset, then every step in lockstep."""

    @abstractmethod
    def words_of_step(self, params: ControlParams, raw: RawCounts, setpoint: Setpoints, step: int) -> dict[str, int]:
        """Reset, run up to and with `step`, and give every word of that step."""

    @abstractmethod
    def stepper(self, params: ControlParams) -> Stepper:
        """Reset, and hand the pace to the caller."""

    def close(self) -> None:  # noqa: B027  (most boards hold nothing open)
        """Let go of the link, if there is one."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def open_board(spec: str, *, link: str = "serial", image: Path | None = None) -> Board:
    """The board that SPEC names; link: how `virtual` is spoken to, serial or can.

    Raises UsageError for a name that is none, LinkError when it does not answer.
    """
    name = parse_board(spec)
    if isinstance(name, SerialName):
        from plumb.boards.link import SerialBoard

        return SerialBoard(name)
    if isinstance(name, CanName):
        from plumb.boards.link import CanBoard

        return CanBoard(name)
    if name.kind == "fixed":
        from plumb.boards.fixed import FixedBoard

        return FixedBoard()
    if name.kind == "native":
        from plumb.boards.native import NativeBoard

        return NativeBoard()
    if name.kind == "qemu":
        from plumb.boards.qemu import QemuBoard

        return QemuBoard()
    from plumb.boards.virtual import VirtualBoard

    return VirtualBoard(image, link)
