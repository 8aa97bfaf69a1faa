"""Samples, setpoints and commands as frames: what a host sends for a step.

The frames of a step come in this order: those of a set of commands, the SETPOINT that completes the set, the other
frames of the sample, the SAMPLE_A that completes the sample. A setpoint and commands are sent when one of them changes.
"""

from __future__ import annotations

from binascii import hexlify
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from plumb.errors import UsageError
from plumb.link.transports.slcan import crc8_columns
from plumb.spec import dbc, declarations
from plumb.spec.protocol import Frame, Protocol
from plumb.spec.system import COUNTS_LEAST

_WITH_B, _WITH_SETPOINT = 0x40, 0x80
_LINE = 22
_PER_FRAME = 3

WholeNumbers = npt.NDArray[Any]  # Any: integers of any width, or floats without a fraction


@dataclass(frozen=True)
class InputLayout:
    """The inputs of a step: so many raw counts, then the words of commands. neutral: these words at the start of a
    run, in whole frames."""

    counts: int = COUNTS_LEAST
    neutral: tuple[int, ...] = ()

    @property
    def size(self) -> int:
        return self.counts + len(self.neutral)

    @property
    def samples(self) -> tuple[str, ...]:
        """The frames of a sample, in the order of the counts."""
        return dbc.sample_frames(self.counts)

    @property
    def commands(self) -> tuple[str, ...]:
        """The frames of a set of commands."""
        return dbc.command_frames(len(self.neutral))


def layout_of(system: str) -> InputLayout:
    """The inputs of a system."""
    declared = declarations.system(system)
    return InputLayout(declared.counts, declared.default_commands())


def whole_inputs(layout: InputLayout, raw: WholeNumbers) -> npt.NDArray[np.int16]:
    """All inputs of the steps, (n, size). raw: (n, 3 or more), the first of them; counts that are missing are 0, and
    commands have the values of the start of a run. Raises UsageError for other shapes and numbers."""
    given = np.asarray(raw)
    if given.ndim == 2 and given.shape[1] <= dbc.inputs_most() and not given[:, layout.size :].any():
        given = given[:, : layout.size]
    if given.ndim != 2 or not _PER_FRAME <= given.shape[1] <= layout.size:
        raise UsageError(f"samples are (n, 3 to {layout.size}), not {given.shape}")
    if given.size and (given.min() < -32768 or given.max() > 32767):
        raise UsageError("a raw count is outside -32768 to 32767")
    whole = np.zeros((len(given), layout.size), "<i2")
    whole[:, layout.counts :] = layout.neutral
    whole[:, : given.shape[1]] = given
    return whole


def frame_lines(
    identifier: int | npt.NDArray[np.int64], second: npt.NDArray[np.uint8], body: npt.NDArray[np.uint8]
) -> npt.NDArray[np.uint8]:
    """SLCAN lines, shape (n, 22), of frames with their CRC.

    identifier: one for all frames, or (n,); second: byte 1, (n,); body: bytes 2 to 7, (n, 6).
    """
    count = len(second)
    entry = np.zeros((count, 10), np.uint8)
    entry[:, 0], entry[:, 1] = identifier >> 4, (identifier << 4 | 8) & 0xFF
    entry[:, 3], entry[:, 4:] = second, body
    entry[:, 2] = np.frombuffer(crc8_columns(entry.tobytes()), np.uint8)
    lines = np.full((count, _LINE), ord("\r"), np.uint8)
    lines[:, 0] = ord("t")
    lines[:, 1:21] = np.frombuffer(hexlify(entry.tobytes()).upper(), np.uint8).reshape(count, 20)
    return lines


@dataclass(frozen=True)
class SampleText:
    """Samples as SLCAN text. The lines of step i are text[ends[i]:ends[i + 1]]."""

    text: bytes
    ends: npt.NDArray[np.int64]

    def part(self, first: int, end: int) -> bytes:
        return self.text[self.ends[first] : self.ends[end]]


@dataclass(frozen=True)
class Said:
    """Newest inputs from a host: the setpoint, and the words of the commands."""

    setpoint: int = 0
    commands: tuple[int, ...] = ()


def samples_text(
    protocol: Protocol,
    raw: WholeNumbers,
    setpoint: WholeNumbers,
    step: int = 0,
    before: Said | None = None,
    run_tag: int = 0,
    layout: InputLayout | None = None,
) -> SampleText:
    """SLCAN text of the samples from number `step` on. raw: inputs, (n, 3 or more); setpoint: (n,) turn_q32.

    The counts behind the first three are sent only if one of them is not zero, setpoint and commands only if they
    differ from the previous ones (`before` for the first sample; None: those of the start of a run). run_tag: of the
    run, in every SETPOINT. layout: of the system; None: six counts.
    """
    layout = layout or InputLayout()
    before = before or Said(0, layout.neutral)
    setpoint = np.asarray(setpoint, np.int64)
    inputs = whole_inputs(layout, raw)
    if setpoint.shape != (len(inputs),):
        raise UsageError(f"samples are (n, 3 to {layout.size}) and setpoints (n,), not {setpoint.shape}")
    counts, commands = inputs[:, : layout.counts], inputs[:, layout.counts :]
    numbers = step + np.arange(len(inputs))
    second: npt.NDArray[np.uint8] = (numbers & 63).astype(np.uint8)
    has_more = counts[:, _PER_FRAME:].any(axis=1)
    last = np.array(before.commands, np.int16).reshape(1, -1)
    has_set = (np.diff(setpoint, prepend=before.setpoint) != 0) | np.diff(commands, axis=0, prepend=last).any(axis=1)
    body = np.zeros((len(inputs), 6), np.uint8)
    body[:, :2] = (numbers & 0xFFFF).astype("<u2").view(np.uint8).reshape(-1, 2)
    body[:, 2:] = (setpoint & 0xFFFFFFFF).astype("<u4").view(np.uint8).reshape(-1, 4)
    flagged = second | (has_more * _WITH_B).astype(np.uint8) | (has_set * _WITH_SETPOINT).astype(np.uint8)
    tagged = (numbers & 15 | run_tag << 4).astype(np.uint8)

    def words_of(columns: npt.NDArray[np.int16], index: int) -> npt.NDArray[np.uint8]:
        return np.ascontiguousarray(columns[:, _PER_FRAME * index : _PER_FRAME * (index + 1)], "<i2").view(np.uint8)

    rows, sent = [], []
    for index, name in enumerate(layout.commands):
        rows.append(frame_lines(protocol[name].identifier, tagged, words_of(commands, index)))
        sent.append(has_set)
    rows.append(frame_lines(protocol["SETPOINT"].identifier, tagged, body))
    sent.append(has_set)
    for index, name in enumerate(layout.samples[1:], 1):
        rows.append(frame_lines(protocol[name].identifier, second, words_of(counts, index)))
        sent.append(has_more)
    rows.append(frame_lines(protocol["SAMPLE_A"].identifier, flagged, words_of(counts, 0)))
    sent.append(np.ones(len(inputs), bool))
    chosen = np.stack(sent, axis=1)
    ends = np.concatenate([[0], np.cumsum(chosen.sum(axis=1) * _LINE)])
    return SampleText(np.stack(rows, axis=1)[chosen].tobytes(), ends)


def command_frames(protocol: Protocol, number: int, commands: Sequence[int], run_tag: int) -> list[Frame]:
    """Frames of a set of commands, without the SETPOINT of step `number` that completes it."""
    names = dbc.command_frames(len(commands))
    parts = (commands[_PER_FRAME * i : _PER_FRAME * (i + 1)] for i in range(len(names)))
    return [
        (protocol[name].identifier, protocol[name].pack(number & 15, run_tag, *part))
        for name, part in zip(names, parts, strict=True)
    ]


def sample_frames(
    protocol: Protocol,
    step: int,
    raw: Sequence[int],
    setpoint: int = 0,
    before: Said | None = None,
    run_tag: int = 0,
    layout: InputLayout | None = None,
) -> list[Frame]:
    """Frames of one sample, with setpoint and commands if they differ from `before`; as samples_text(), but without
    arrays, and for inputs that are known to fit."""
    layout = layout or InputLayout()
    before = before or Said(0, layout.neutral)
    counter, high = step & 15, step >> 4 & 3
    counts = [*raw[: layout.counts], *(0,) * (layout.counts - len(raw))]
    commands = tuple(raw[layout.counts : layout.size]) or layout.neutral
    has_more, has_set = any(counts[_PER_FRAME:]), (setpoint, commands) != (before.setpoint, before.commands)
    frames = []
    if has_set:
        frames += command_frames(protocol, step, commands, run_tag)
        message = protocol["SETPOINT"]
        frames.append((message.identifier, message.pack(counter, run_tag, step & 0xFFFF, setpoint)))
    for index, name in enumerate(layout.samples[1:] if has_more else (), 1):
        words = counts[_PER_FRAME * index : _PER_FRAME * (index + 1)]
        frames.append((protocol[name].identifier, protocol[name].pack(counter, high, *words)))
    message = protocol["SAMPLE_A"]
    frames.append(
        (message.identifier, message.pack(counter, high | has_more << 2 | has_set << 3, *counts[:_PER_FRAME]))
    )
    return frames
