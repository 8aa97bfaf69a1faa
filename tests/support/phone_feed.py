"""What sends a phone's datagrams on loopback, and a board that fails while it is fed."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable
from typing import Any

from plumb.boards.contract import RawCounts, StepBoard, StepOutput, Stepper
from plumb.contract.parameters import ControlParams
from plumb.errors import LinkError


class Sender(threading.Thread):
    """Sends on loopback, never far ahead of what was taken: a socket's buffer holds few datagrams."""

    def __init__(self, port: int, datagrams: list[bytes], taken: Callable[[], int], host: str = "127.0.0.1") -> None:
        super().__init__(daemon=True)
        self._port, self._datagrams, self._taken, self._host = port, datagrams, taken, host
        self.stopped = threading.Event()

    def run(self) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            out.bind((self._host, 0))
            for sent, data in enumerate(self._datagrams):
                while sent - self._taken() > 50 and not self.stopped.wait(0.001):
                    pass
                if self.stopped.is_set():
                    return
                out.sendto(data, ("127.0.0.1", self._port))


class Wrong(StepBoard):
    """A board whose integers go wrong at its 200th step, or that goes away there."""

    name = "wrong"

    def __init__(self, board: StepBoard, *, dies: bool = False) -> None:
        self._board, self._dies = board, dies

    def run_injected(self, *_: Any) -> Any:
        raise AssertionError

    def words_of_step(self, params: ControlParams, raw: Any, setpoint: Any, step: int) -> dict[str, int]:
        words = self._board.words_of_step(params, raw, setpoint, step)
        return {**words, "roll_p11": words["roll_p11"] + 1}

    def stepper(self, params: ControlParams) -> Stepper:
        inner, dies = self._board.stepper(params), self._dies

        class Stepping:
            steps = 0

            def step(self, raw: tuple[int, ...], setpoint: int) -> StepOutput:
                self.steps += 1
                if dies and self.steps == 200:
                    raise LinkError("the board went away")
                output = inner.step(raw, setpoint)
                return StepOutput(output.digest ^ (self.steps == 200), output.outputs)

            def digests(self, raw: RawCounts) -> list[int]:
                return [self.step(tuple(row), 0).digest for row in raw.tolist()]

        return Stepping()
