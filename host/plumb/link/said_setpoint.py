"""The setpoint and the commands that a session has said last, and the step number that makes them count.

In real time the board takes a setpoint only with a newer number than the last one: that of the next step, as far as the
host knows from STEP and TIME. So what a buffer or an adapter repeats does not steer.
"""

from __future__ import annotations

from plumb.link.sample_codec import command_frames
from plumb.spec.protocol import Frame, Protocol

SETPOINT_EVERY_S = 0.05
"""Interval at which the setpoint is repeated; the board treats a source that is silent for 200 ms as lost."""


class SaidSetpoint:
    """value: said last; 0 at the beginning of a run. commands: the words of the commands that come with it; neutral:
    those of the beginning of a run. waits: it has not been sent yet, because no step has come since the setpoint before
    it. repeats: say it again while the board is armed. next_step: as the board has said."""

    def __init__(self, protocol: Protocol) -> None:
        self.next_step = 0
        self.value, self.waits, self.repeats = 0, False, False
        self.commands: tuple[int, ...] = ()
        self.neutral: tuple[int, ...] = ()
        self._protocol = protocol
        self._sent_number: int | None = None
        self._ended_at: int | None = None
        self._sent_s = 0.0
        self._step, self._time = protocol["STEP"], protocol["TIME"]

    def begin(self, neutral: tuple[int, ...] = ()) -> None:
        """A run has begun: its setpoint is 0, and its commands are neutral."""
        self.neutral = neutral
        self.next_step, self._sent_number, self._ended_at = 0, None, None
        self.stop()

    def end(self) -> None:
        """An arming has ended, and its setpoint with it. The board takes none with the number of the next step at that
        time, which may be one more than this host knows: the next setpoint waits for a newer number."""
        self.stop()
        self._ended_at = self.next_step

    def stop(self) -> None:
        """Say nothing any more."""
        self.value, self.commands, self.waits = 0, self.neutral, False

    def follow(self, frames: list[Frame]) -> None:
        """Learn the number of the next step from the newest STEP or TIME."""
        for identifier, data in reversed(frames):
            if identifier == self._step.identifier:
                self.next_step = self._step.unpack(data)[2] + 1 & 0xFFFF
                return
            if identifier == self._time.identifier:
                self.next_step = self._time.unpack(data)[2]
                return

    def say(self, value: int, commands: tuple[int, ...] | None = None, *, repeats: bool) -> None:
        """Say this setpoint, with the commands that were said last or these."""
        self.value, self.waits, self.repeats = value, True, repeats
        self.commands = self.commands if commands is None else commands

    @property
    def moves(self) -> bool:
        """Whether setpoint or commands are others than at the beginning of a run."""
        return self.value != 0 or self.commands != self.neutral

    def set_frames(self, run_tag: int) -> list[Frame]:
        """The frames of the commands, which the SETPOINT of this step completes."""
        return command_frames(self._protocol, self.next_step, self.commands, run_tag)

    def due(self, now_s: float, *, armed: bool) -> bool:
        """Whether to send it now: it waits for a new number that has come, or it is time to repeat it."""
        if self.waits:
            if self._ended_at is not None and self.next_step - self._ended_at & 0xFFFF > 1:
                self._ended_at = None
            return self._ended_at is None and self.next_step != self._sent_number
        return armed and self.repeats and self.moves and now_s - self._sent_s >= SETPOINT_EVERY_S

    def sent(self, now_s: float) -> None:
        """It goes out with the present number."""
        self.waits, self._sent_number, self._sent_s = False, self.next_step, now_s
