"""Which frames of a step a board can send, and their bits in SELECT."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from plumb.errors import UsageError
from plumb.spec import dbc, declarations
from plumb.spec.system import COUNTS_LEAST


@dataclass
class Selection:
    """The telemetry that the board sends after the STEP of every step: frames by name, words by position in the
    record."""

    frames: tuple[str, ...] = ()
    words: tuple[int, ...] = ()

    def count(self) -> int:
        return len(self.frames) + len(self.words)

    def banks(self, bits: Mapping[str, int], record_words: int) -> list[int]:
        """The masks of SELECT, by bank. bits: of the frames, in bank 0. Raises UsageError for a word behind the
        record."""
        banks = [0] * (1 + (record_words + 31) // 32)
        banks[0] = sum(1 << bits[frame] for frame in set(self.frames))
        for word in self.words:
            if not 0 <= word < record_words:
                raise UsageError(f"the board's record has no word {word}")
            banks[1 + word // 32] |= 1 << word % 32
        return banks


RAW_FRAMES = dbc.raw_frames(dbc.inputs_most())
"""Frames with the inputs of a step, of the system with the most."""
MORE_RAW_BIT = 14
"""Bit of SELECT bank 0 of RAW_C; the frames after it follow."""


def raw_frames_of(system: str) -> tuple[str, ...]:
    """The RAW frames that carry the counts of a system's channels and its commands."""
    declared = declarations.system(system)
    channels = len(declared.channels)
    return dbc.raw_frames(declared.inputs if declared.step_commands or channels > COUNTS_LEAST else channels)


def select_bits(system: str) -> dict[str, int]:
    """Frames that can be selected for a system, with their bits of SELECT bank 0."""
    raw, named = dbc.raw_frames(declarations.system(system).inputs), dbc.frame_names(system)
    bits = {name: bit for bit, name in enumerate((*raw[:2], *named))}
    return {**bits, **{name: MORE_RAW_BIT + i for i, name in enumerate(raw[2:])}}


def selectable(system: str) -> tuple[str, ...]:
    """Frames that can be selected for a system, in the order of the bits of SELECT bank 0."""
    return tuple(select_bits(system))
