"""Inputs and parameters that reach code which no scenario reaches, for short golden vectors: `wild = "reach"` of a
recipe.

Both come from the seed alone. Parameters: those of the tuning, some of them moved to an end of their range, next to it,
or to any size, as long as the words stay valid together. Counts: pieces of a few steps, at rest, at the rails, one
count from them, in ramps, with spikes, with steps that no sensor has, and with values that the calibration makes 0 or
1.

The seeds of a recipe are chosen by the branches that their vectors reach and the mutants that they kill.
"""

from __future__ import annotations

from collections.abc import Callable, Set
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from plumb.boards.contract import RawCounts, Setpoints
from plumb.contract import run_fixed
from plumb.contract.parameters import ControlParams
from plumb.proof.golden_random import Draw
from plumb.spec import declarations, parameters
from plumb.spec.parameters import Parameter

LIMIT = 7 << 28
"""Limit of a calibrated value."""
MISSING = -32768
CALIBRATION = ("raw_min", "raw_max", "gain", "offset")
MATRIX = tuple(f"{row}{column}_q30" for row in "xyz" for column in "xyz")
Counts = npt.NDArray[np.int64]


def reach(
    params: ControlParams, seed: int, steps: int, kept: Set[str] = frozenset()
) -> tuple[ControlParams, RawCounts, Setpoints]:
    """Parameters, counts and setpoints of one vector. kept: names of parameters that stay as they are."""
    draw = Draw(seed)
    found = moved(params, draw, kept)
    raw, setpoint = pieces(found, draw, steps)
    return found, raw.astype(np.int16), setpoint.astype(np.int32)


def moved(params: ControlParams, draw: Draw, kept: Set[str] = frozenset()) -> ControlParams:
    """The parameters with changed words in the groups that the system reads. Words are changed one by one; a change
    that makes the set invalid is dropped."""
    share = draw.of((0, 40, 40, 150, 400, 900))
    groups = declarations.system(params.system).all_groups
    rows = [row for row in parameters.table() if row.owner == "control" and row.group in groups]
    for group in groups:
        if draw.chance(share):
            words = _together(group, [row.name for row in rows if row.group == group], draw)
            params = params if kept & set(words) else _kept(params, words)
    for row in sorted(rows, key=lambda row: (draw.bits(), row.name)):
        if draw.chance(share) and row.name not in kept:
            params = _kept(params, {row.name: value_of(row, params[row.name], draw)})
    return params


def _kept(params: ControlParams, words: dict[str, int]) -> ControlParams:
    changed = replace(params, values={**params.values, **words})
    inside = all(row.min <= words[row.name] <= row.max for row in parameters.table() if row.name in words)
    return changed if inside and run_fixed.params_valid(changed) else params


def value_of(row: Parameter, now: int, draw: Draw) -> int:
    """An end of the range, its neighbour, a neighbour of the present value, or any value in the range."""
    low, high = row.min, row.max
    kind = draw.below(8)
    if kind < 4:
        return (low, high, min(low + 1, high), max(high - 1, low))[kind]
    if kind == 4:
        return min(max(now + draw.below(5) - 2, low), high)
    size = draw.below(1 << draw.below(33))
    return min(max(-size if draw.chance(500) and low < 0 else size, low), high)


def _together(group: str, names: list[str], draw: Draw) -> dict[str, int]:
    """Words of a group that must change together: a calibration over its whole range of values, axes that are
    mapped."""
    own = {name.rpartition(".")[2] for name in names}
    if set(CALIBRATION) <= own:
        low, high = sorted((draw.below(65536) - 32768, draw.of((32767, -32768, 4095, 0))))
        span = max(high - low, 1)
        value = draw.of((LIMIT, LIMIT, 1 << 28, 1 << 26, draw.below(LIMIT)))
        gain = max(2 * value // span, 1) * draw.of((1, -1))
        words = (low, high, gain, -gain * low - _sign(gain) * value)
        return {f"{group}.{name}": word for name, word in zip(CALIBRATION, words, strict=True)}
    if set(MATRIX) <= own:
        order = draw.of(((0, 1, 2), (1, 2, 0), (2, 0, 1)))
        one = (1 << 30) + draw.of((0, 0, draw.below(1 << 26)))
        other = draw.of((0, 0, draw.below(1 << 28)))
        entries = [one if column == order[row] else other for row in range(3) for column in range(3)]
        return {f"{group}.{name}": entry for name, entry in zip(MATRIX, entries, strict=True)}
    return {}


def _sign(x: int) -> int:
    return 1 if x > 0 else -1


class _Channel:
    """Interesting counts of one channel: around the ends of its range, and where its value is 0, 1 or limited."""

    def __init__(self, params: ControlParams, group: str) -> None:
        self.low, self.high, self.gain, self.offset = (
            (params[f"{group}.{name}"] for name in CALIBRATION) if group else (-32768, 32767, 1, 0)
        )

    def pick(self, draw: Draw) -> int:
        kind = draw.below(6)
        if kind == 0:
            return draw.of((self.low, self.high)) + draw.below(3) - 1
        if kind == 1:
            return draw.of((MISSING, -32767, -1, 0, 1, 32766, 32767))
        if kind == 2:
            return draw.below(65536) - 32768
        return self.worth(draw.of((0, 0, 1, -1)) << draw.of((20, 24, 25, 26, 26, 28, 30)), draw)

    def worth(self, value: int, draw: Draw) -> int:
        """The count of a value, or a neighbouring one."""
        return (value - self.offset) // (self.gain or 1) + draw.below(3) - 1


def pieces(params: ControlParams, draw: Draw, steps: int) -> tuple[Counts, Counts]:
    """Counts (steps, 6) and setpoints (steps,)."""
    declared = declarations.system(params.system).channels
    channels = [_Channel(params, channel.calibration) for channel in declared]
    whole = declarations.system(params.system).whole_inputs([])
    raw, setpoint = np.tile(np.array(whole, np.int64), (steps, 1)), np.zeros(steps, np.int64)
    longest, at, now = draw.of((3, 20, 60, 60)), 0, 0
    while at < steps:
        count = min(1 + draw.below(longest), steps - at)
        begin = np.array([channel.pick(draw) for channel in channels])
        if at and draw.chance(300):
            begin = raw[at - 1, : len(channels)].copy()
        piece = draw.of(_PIECES)(draw, begin, count)
        raw[at : at + count, : len(channels)] = piece
        if draw.chance(300):
            now = draw.of(
                (0, 0, 1, -1, (1 << 31) - 1, -(1 << 31), draw.below(1 << 32) - (1 << 31), draw.below(1 << 26))
            )
        setpoint[at : at + count] = now
        at += count
    return np.clip(raw, -32768, 32767), setpoint


def _hold(_: Draw, begin: Counts, count: int) -> Counts:
    return np.tile(begin, (count, 1))


def _noise(draw: Draw, begin: Counts, count: int) -> Counts:
    size = 1 << draw.below(10)
    noise: Counts = np.array([[draw.below(2 * size + 1) - size for _ in begin] for _ in range(count)])
    return begin + noise


def _ramp(draw: Draw, begin: Counts, count: int) -> Counts:
    slope: Counts = np.array([(draw.below(1 << (1 + draw.below(12)))) * draw.of((1, -1, 0)) for _ in begin])
    ramp: Counts = begin + np.arange(count)[:, None] * slope
    return ramp


def _swing(draw: Draw, begin: Counts, count: int) -> Counts:
    """From the piece's counts to their mirror image and back, every few steps."""
    period = 1 + draw.below(4)
    return np.where((np.arange(count) // period % 2 == 0)[:, None], begin, -begin)


def _spike(draw: Draw, begin: Counts, count: int) -> Counts:
    piece = np.tile(begin, (count, 1))
    piece[draw.below(count), draw.below(len(begin))] = draw.below(65536) - 32768
    return piece


def _missing(draw: Draw, begin: Counts, count: int) -> Counts:
    """Steps without a sample of some channels: of all, of the first three, of the others, of one."""
    piece, split = np.tile(begin, (count, 1)), min(3, len(begin))
    gone = draw.of((slice(0, None), slice(0, split), slice(split, None), slice(draw.below(len(begin)), None)))
    every = draw.of((1, 1, 2, 3, 4))
    piece[::every, gone] = MISSING
    return piece


_PIECES: tuple[Callable[[Draw, Counts, int], Counts], ...] = (
    _hold,
    _hold,
    _noise,
    _noise,
    _ramp,
    _swing,
    _spike,
    _missing,
)
