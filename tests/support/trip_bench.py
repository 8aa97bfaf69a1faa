"""A trip for tests: its loop turned by hand as fast as the machine is, or served in a thread."""

from __future__ import annotations

import contextlib
import functools
import threading
from collections.abc import Iterator
from pathlib import Path

from plumb.cockpit.arming import Answer
from plumb.cockpit.hold import Hold
from plumb.cockpit.page_orders import Order
from plumb.cockpit.page_server import PageServer
from plumb.cockpit.steering.transmitter import Sticks
from plumb.cockpit.steering.trip_loop import TripLoop
from plumb.cockpit.steering.trip_page import ASSETS, TripPage
from support.chromium import Page

PILOT = 1
PAD = """
  window.pad = { id: "scripted", connected: true, axes: [0, 0, 0, 0],
    buttons: Array.from({ length: 12 }, () => ({ pressed: false })) };
  navigator.getGamepads = () => [window.pad];
"""
"""A gamepad of a page, as its script moves it."""


class TripBench:
    """wall_s: the clock of the transmitter, which the test alone moves."""

    def __init__(self, system: str, folder: Path, board: str = "native") -> None:
        self.wall_s = 0.0
        self.loop = TripLoop(system, 1000, Hold(clock=lambda: 0.0), folder=folder, paced=False, board=board)
        self.loop.transmitter._clock = lambda: self.wall_s
        self.loop.hold.take(PILOT)
        self.loop._begin_or_join()

    def turn(self, seconds: float, **sticks: float | bool) -> None:
        """Let time of the trip pass with these sticks; without any the pilot says nothing."""
        if sticks:
            self.loop.accept_sticks(PILOT, Sticks(**sticks))  # type: ignore[arg-type]
        end_s = self.loop._session.clock() + seconds
        while self.loop._session.clock() < end_s:
            self.loop.turn()

    def order(self, verb: str, name: str = "", page: int = PILOT) -> Answer:
        answers: list[Answer] = []
        self.loop.order(Order(verb, page, name=name), answers.append)
        self.loop.turn()
        return answers[0]

    def arm(self) -> None:
        """Wait until the sensors have settled, and switch the motors on."""
        self.turn(self.loop._steered.SETTLED_S + 0.5, on=False)
        self.turn(0.5, on=True)
        assert self.loop.state["armed"], self.loop.state

    def reading(self, label: str) -> float:
        """What the page shows below that label."""
        at = [reading.label for reading in self.loop._steered.DRAWING.readings].index(label)
        readings = self.loop.scene["readings"]
        assert isinstance(readings, list)
        return float(readings[at])

    @property
    def height_m(self) -> float:
        position = self.loop.scene["position"]
        assert isinstance(position, list)
        return float(position[2])


@contextlib.contextmanager
def steering(loop: TripLoop) -> Iterator[PageServer]:
    """Its page, while the loop runs in a thread."""
    ended = threading.Event()
    thread = threading.Thread(target=loop.run, args=(ended.is_set,))
    with PageServer(loop, assets=ASSETS, opened=functools.partial(TripPage, loop)) as server:
        thread.start()
        try:
            yield server
        finally:
            ended.set()
            thread.join()


def press(page: Page, button: int) -> None:
    """Press a button of the gamepad of a page."""
    for pressed in ("true", "false"):
        page.value(f"pad.buttons[{button}].pressed = {pressed}; new Promise((then) => setTimeout(then, 120))")
