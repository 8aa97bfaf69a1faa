"""What a board does with the commands of the toy system: `commands_on_board.py IMAGE LOG` prints it as JSON.

A program of its own, because a process has the systems of its PLUMB_SYSTEM_PATH for good. LOG: where the recording of
the live run goes.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np

from plumb import systems
from plumb.boards import open_board
from plumb.boards.contract import SimulatedBoard
from plumb.boards.plant_on_pins import configure_as
from plumb.contract import run_fixed
from plumb.contract.parameters import ControlParams, quantise
from plumb.link.identity import NackError
from plumb.link.realtime import Capture
from plumb.link.sample_codec import command_frames
from plumb.link.selection import raw_frames_of
from plumb.link.session import Session
from plumb.spec import declarations
from plumb.spec.protocol import Frame
from plumb.writers.recorder import Recorder

STEPS = 40
SET = {"gain": -3, "heading": -(1 << 30) + 5, "trim": -100, "mode": 1}


class Commands:
    """A live run of the toy whose commands are set in several ways."""

    def __init__(self, session: Session, params: ControlParams) -> None:
        self.session, self.params, self.declared = session, params, declarations.system("toy")
        self.capture = Capture(session, raw_frames=raw_frames_of("toy"))

    def begin(self) -> None:
        self.session.begin("REALTIME_LIVE", frames=raw_frames_of("toy"))

    def used(self) -> list[int]:
        """The commands of the newest step, after STEPS more steps."""
        self.capture.collect(self.capture.steps + STEPS)
        raw = self.capture.raw_counts(self.capture.steps - 1)
        return [int(word) for word in raw[-1, self.declared.counts :]]

    def set_frames(self, **values: int) -> list[Frame]:
        return command_frames(
            self.session.protocol,
            self.session.setpoint.next_step,
            self.declared.pack_commands(values),
            self.session.run_tag,
        )

    def refused(self, frames: list[Frame]) -> str:
        """Why the SETPOINT of the next step is refused after these frames; "" when it is taken."""
        self.session.send(frames)
        try:
            self.session.request(
                "SETPOINT", self.session.setpoint.next_step, 7, answer="SETPOINT_USED", flags=self.session.run_tag
            )
        except NackError as error:
            return error.reason
        return ""

    def beyond(self) -> list[Frame]:
        """A set with a gain beyond its limit."""
        words = list(self.declared.pack_commands({}))
        words[0] = 4
        return command_frames(self.session.protocol, self.session.setpoint.next_step, words, self.session.run_tag)

    def split(self) -> list[Frame]:
        """The first frame of a set now, the others of one 16 steps later, whose number has the same low bits."""
        step = self.session.setpoint.next_step
        self.session.send(self.set_frames(gain=2)[:1])
        while self.session.setpoint.next_step < step + 16:
            self.session.receive(0.1)
        while self.session.setpoint.next_step & 15 != step & 15:
            self.session.receive(0.1)
        return self.set_frames(gain=2)[1:]


def elsewhere(session: Session) -> str:
    """Whether setpoints and commands may come over the other link."""
    try:
        session.begin("REALTIME_LIVE", elsewhere=("setpoints",))
    except NackError as error:
        return error.reason
    return ""


def main(image: Path, log: Path) -> None:
    params = quantise(systems.load("toy").TUNINGS["slow"])
    with open_board("virtual", image=image) as board:
        assert isinstance(board, SimulatedBoard)
        session = configure_as(board, params)
        commands = Commands(session, params)
        said: dict[str, object] = {"elsewhere": elsewhere(session)}
        recorder = Recorder(session, log, {"command": "a test"})

        def received(frames: list[Frame]) -> None:
            commands.capture.feed(frames)
            recorder.feed(frames)

        session.listener = received
        commands.begin()
        said["at_start"] = commands.used()
        said["alone"] = commands.refused([])
        whole = commands.set_frames(gain=2)
        said["incomplete"] = commands.refused(whole[:1])
        said["out_of_order"] = commands.refused(commands.set_frames(gain=2)[::-1])
        said["beyond"] = commands.refused(commands.beyond())
        said["mixed"] = commands.refused(commands.split())
        said["after_refusals"] = commands.used()
        session.set_commands(SET, 5 << 16)
        said["set"] = commands.used()
        session.end()
        recorder.close("done")
        capture, steps = commands.capture, commands.capture.steps - 1
        raw = capture.raw_counts(steps)[:, commands.declared.counts :]
        said["different_sets"] = len(np.unique(raw, axis=0))
        setpoints = capture.setpoints.of_steps(steps)
        said["with_setpoint"] = bool(((raw[:, 0] == SET["gain"]) == (setpoints == 5 << 16)).all())
        words = run_fixed.run_control(params, capture.raw_counts(steps), setpoints)
        said["mismatches"] = int(np.count_nonzero(words.digests() != capture.digests(steps)))
    print(json.dumps(said))


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
