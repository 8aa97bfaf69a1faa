"""Assemble the frames of a sensor board to whole samples: commands, SETPOINT and the other frames of a sample precede
their SAMPLE_A."""

from __future__ import annotations

from plumb.spec import dbc
from plumb.spec.protocol import Frame, protocol

SAMPLE_MESSAGES = (
    *dbc.sample_frames(dbc.counts_most()),
    *dbc.command_frames(dbc.command_words_most()),
    "SETPOINT",
)
"""Messages that a sensor board sends for a step."""


class Samples:
    """The samples of one sensor board. setpoint: the last SETPOINT frame; the sensor board sends it once, and it also
    holds for a run that begins later."""

    def __init__(self) -> None:
        names = protocol()
        self._last, self._setpoint = names["SAMPLE_A"].identifier, names["SETPOINT"].identifier
        self._parts = {names[name].identifier for name in SAMPLE_MESSAGES}
        self.forget()

    def forget(self) -> None:
        """Start anew, for another sensor board."""
        self.setpoint: Frame | None = None
        self._begun: dict[int, Frame] = {}  # the newest frame of each kind: a lost SAMPLE_A leaves its other frames

    def assemble(self, arrived: list[tuple[float, Frame]]) -> list[tuple[float, list[Frame]]]:
        """The samples that these frames complete, each with the receive time of its SAMPLE_A."""
        whole = []
        for time_s, frame in arrived:
            if frame[0] in self._parts:
                self._begun.pop(frame[0], None)
                self._begun[frame[0]] = frame
            if frame[0] == self._setpoint:
                self.setpoint = frame
            if frame[0] == self._last:
                whole.append((time_s, list(self._begun.values())))
                self._begun = {}
        return whole
