"""A simulated board whose body is held by a hand: for calibrating its sensors, whose errors a seed draws."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from plumb import systems
from plumb.boards.link import LinkBoard
from plumb.contract.parameters import quantise
from plumb.contract.scenario import sensor_words
from plumb.physics.hand import Hand
from plumb.systems.contracts import PINS, POSES


@dataclass(frozen=True)
class HeldBoard:
    """The board and the hand."""

    board: LinkBoard
    hand: Hand

    def put(self, pose: str) -> None:
        """Turn it to this pose within a second of its time."""
        self.hand.put(pose)


def open_held(kind: str, name: str, seed: int, *, link: str = "serial", image: Path | None = None) -> HeldBoard:
    """The board `native` or `virtual` as this system, its body in the first pose. Raises UsageError for a system
    without poses."""
    plant, hand = systems.load(name, POSES).held(seed)
    if kind == "native":
        from plumb.boards.native.port import NativePort

        return HeldBoard(NativePort(name, plant), hand)
    from plumb.boards.plant_on_pins import FOUND_US, configure_as
    from plumb.boards.virtual import VirtualBoard

    board = VirtualBoard(image, link)
    system, live = systems.load(name), systems.load(name, PINS)
    tuning = system.TUNINGS[live.TUNING]
    words = {**system.LINK, **sensor_words(system, live.TUNING)}
    configure_as(board, quantise(tuning), period_us=tuning.period_us, **words)
    live.couple(board.machine, plant)
    board.machine.advance_us(FOUND_US)
    return HeldBoard(board, hand)
