"""Source of the samples of an injected run, in the time of the scene."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from plumb.link.sample_codec import InputLayout, sample_frames
from plumb.link.session import Session
from plumb.spec.protocol import Frame, protocol

KEPT = 64
"""Number of samples with different numbers."""


@dataclass
class Source:
    """Sends a sample every period. counts: the counts at a time in s, layout: of the system's inputs.
    circle: number of its last samples that it repeats again and again; 0: new samples."""

    counts: Callable[[float], Sequence[int]]
    layout: InputLayout
    period_s: float
    next_s: float
    number: int = 0
    circle: int = 0
    stopped: bool = False
    sent: list[list[Frame]] = field(default_factory=list)

    def send_due(self, session: Session) -> None:
        """Send the samples that are due by now."""
        while not self.stopped and session.clock() >= self.next_s:
            self.next_s += self.period_s
            if self.circle:
                frames = self.sent[-self.circle]
            else:
                frames = sample_frames(protocol(), self.number, self.counts(self.next_s), layout=self.layout)
                self.number += 1
            self.sent = [*self.sent[1 - KEPT :], frames]
            session.frames.write_frames(frames)
