"""A cockpit on the native board: its loop turned by hand, with a clock of the test for the page that holds it.

The board has no plant: its sensors say level and at rest, so that it can be armed at any time."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Iterator
from pathlib import Path

from plumb.boards.link import LinkBoard
from plumb.boards.native.port import NativePort
from plumb.cockpit.arming import Answer
from plumb.cockpit.board_loop import BoardLoop
from plumb.cockpit.hold import Hold
from plumb.cockpit.page_orders import Order
from plumb.cockpit.page_server import PageServer

HOLDER = 1
TURNS_MAX = 10000
NEUTRAL_HALFUS = 2000
"""Pulse of a disarmed speed controller of `quad`."""


class CockpitBench:
    """now_s: of the hold's clock, which the test alone moves. A turn is 10 ms of the board's time."""

    def __init__(
        self,
        folder: Path,
        *,
        hold: Hold | None = None,
        paced: bool = False,
        watch: bool = False,
        system: str = "quad",
    ) -> None:
        self.system = system
        self.now_s = 0.0
        self.hold = hold or Hold(clock=lambda: self.now_s)
        self.folder = folder
        self.board = NativePort(self.system, None)
        self.loop = BoardLoop(self.board, self.hold, folder=folder, paced=paced, watch=watch, reopen=self._reopen)

    def _reopen(self) -> LinkBoard:
        self.board = NativePort(self.system, None)
        return self.board

    def begin(self) -> None:
        self.loop._begin_or_join()

    def beat(self) -> None:
        self.hold.beat(HOLDER, self.hold.next_tick())

    def turn(self, seconds: float, *, beating: bool = True) -> None:
        """Let the board's time pass; beating: the holder is alive."""
        end_s = self.board.session.clock() + seconds
        while self.board.session.clock() < end_s:
            if beating:
                self.beat()
            self.loop.turn()

    def ask(self, verb: str, page: int = HOLDER, **more: float | str | bool) -> list[Answer]:
        """Give an order; the answers come with the turns."""
        answers: list[Answer] = []
        self.loop.order(Order(verb, page, **more), answers.append)  # type: ignore[arg-type]
        return answers

    def answer(self, verb: str, page: int = HOLDER, **more: float | str | bool) -> Answer:
        """Give an order, and let time pass until its answer is there; some come from another thread."""
        answers = self.ask(verb, page, **more)
        for _ in range(TURNS_MAX):
            self.turn(0.01)
            if answers:
                return answers[0]
            time.sleep(0.001)
        raise AssertionError(f"no answer to {verb}")

    def arm(self) -> None:
        """Take control and arm, as the first page does."""
        assert self.hold.take(HOLDER)
        self.turn(1.0)
        said = self.ask("arm")
        self.turn(0.2)
        assert said == [{"good": True, "text": "armed"}]
        assert self.loop.state["armed_here"]

    def pulses(self) -> list[int]:
        return list(self.board.mcu.wires.pulse_halfus)[:2]

    @property
    def armed(self) -> bool:
        """What the board's own STATUS says."""
        return bool(self.board.session.telemetry["STATUS"]["armed"])

    def recorded(self) -> Path:
        """The log of the recording that was stopped, written to its end."""
        self.turn(0.1)
        self.loop.recording.wait()
        (path,) = self.folder.glob("*.plog")
        return path

    def close(self) -> None:
        self.loop.recording.stop()
        self.loop.recording.wait()
        self.board.close()


@contextlib.contextmanager
def serving(loop: BoardLoop) -> Iterator[PageServer]:
    """The page of a simulated board, whose loop runs in a thread. Time of the board passes as outside, or slower, but
    never without its host: a machine that is busy disarms nothing."""
    ended = threading.Event()
    thread = threading.Thread(target=loop.run, args=(ended.is_set,))
    with PageServer(loop) as server:
        thread.start()
        try:
            yield server
        finally:
            ended.set()
            thread.join()


def colour(bench: CockpitBench) -> str:
    """Of the light that the pages see."""
    light = bench.loop.state["light"]
    assert isinstance(light, dict)
    return str(light["colour"])


def run_number(bench: CockpitBench) -> int:
    """Of the run that the pages see; 1 is the first."""
    run = bench.loop.state["run"]
    assert isinstance(run, dict)
    return int(run["number"])
