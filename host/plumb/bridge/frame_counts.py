"""Frame counts of one side of a bridge, and the counters of the board while the bridge is its host."""

from __future__ import annotations

from dataclasses import dataclass, field

from plumb.spec import dbc
from plumb.spec.protocol import check, protocol

_RAW = dbc.raw_frames(dbc.inputs_most())
_PARTS = (*dbc.sample_frames(dbc.counts_most())[1:], *dbc.command_frames(dbc.command_words_most()), "SETPOINT")


@dataclass
class Flow:
    """Frame counts of one side. lost: gaps in the frame counter; rejected: CRC errors; foreign: unknown identifiers;
    opened: how often the endpoint was opened."""

    frames: int = 0
    lost: int = 0
    rejected: int = 0
    foreign: int = 0
    opened: int = 0
    _last: dict[int, int] = field(default_factory=dict, repr=False)

    def note(self, identifier: int, data: bytes) -> bool:
        """Count a frame; False when it must not be forwarded."""
        message = protocol().by_identifier.get(identifier)
        if message is None:
            self.foreign += 1
            return False
        if not check(identifier, data):
            self.rejected += 1
            return False
        self.frames += 1
        if message.name == "HELLO":
            self.forget()  # a host counts anew from there
        # SAMPLE and RAW are numbered by their step in six bits; one of four repeats what its SAMPLE_A says.
        wide = message.name in ("SAMPLE_A", *_RAW)
        if message.name not in _PARTS:
            mask = 63 if wide else 15
            number = data[1] & mask
            last = self._last.get(identifier)
            self.lost += 0 if last is None else number - last - 1 & mask
            self._last[identifier] = number
        return True

    def forget(self) -> None:
        """A new connection begins: frame counters restart."""
        self._last.clear()


@dataclass
class BoardCounts:
    """Increments of the board's own counters while this bridge is its host.

    lost: gaps in the sample numbers, including samples that the bridge skipped or never received.
    """

    rejected: int = 0
    lost: int = 0
    dropped: int = 0
    starved: int = 0
    _last: dict[str, int] = field(default_factory=dict, repr=False)

    def note(self, telemetry: dict[str, dict[str, int]]) -> None:
        said = {**telemetry.get("COUNTERS", {}), **telemetry.get("EVENTS", {})}
        for name in ("rejected", "lost", "dropped", "starved"):
            if name in said:
                grown = said[name] - self._last.get(name, said[name]) & 0xFFFF
                setattr(self, name, getattr(self, name) + grown)
                self._last[name] = said[name]

    def forget(self) -> None:
        """The board may have restarted: the next counters are the new baseline."""
        self._last.clear()
