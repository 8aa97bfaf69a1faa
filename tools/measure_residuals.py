"""Measure which errors on the UART the firmware does not detect: damaged lines through the C parser and the CRC check.

A residual error is a frame that the receiver accepts although nobody sent it. Every trial damages one SLCAN line (22
bytes, 176 data bits, CR included) of a random frame with a right CRC in one place; start and stop bits are left alone.
`tools/gen_protocol.py` writes the table into docs/reference/protocol.md. Run alone, it prints the table;
`--times 10` takes ten times the trials.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT / "host"), str(ROOT / "tests")]

from plumb.link.sample_codec import frame_lines  # noqa: E402
from plumb.link.transports.slcan import text_of_frames  # noqa: E402
from support.link_functions import parse  # noqa: E402

TRIALS = 100_000
"""Damaged lines of each kind in the published table."""
RARE_TRIALS = 1_000_000
"""The same for the kinds of RARE, of which few per million pass."""
_CHUNK = 100_000
_LINE = 22

Lines = npt.NDArray[np.uint8]
"""Shape (n, 22) before the damage, (n, any) after it."""


class Draw:
    """Uniform integers from the raw words of PCG64, the same with every version of numpy."""

    def __init__(self, seed: int) -> None:
        self._words = np.random.PCG64(seed)

    def below(self, limit: int, *shape: int) -> npt.NDArray[np.int64]:
        """Integers 0..limit-1."""
        raw = self._words.random_raw(int(np.prod(shape)))
        return ((raw >> np.uint64(32)) * np.uint64(limit) >> np.uint64(32)).astype(np.int64).reshape(shape)


Damage = Callable[[Draw, Lines], Lines]


def distinct(draw: Draw, limit: int, count: int, each: int) -> npt.NDArray[np.int64]:
    """(count, each) integers 0..limit-1, different ones in every row."""
    rows = draw.below(limit, count, each)
    while True:
        ordered = np.sort(rows, axis=1)
        again = (ordered[:, 1:] == ordered[:, :-1]).any(axis=1)
        if not again.any():
            return rows
        rows[again] = draw.below(limit, int(again.sum()), each)


def flip_bits(count: int) -> Damage:
    def damage(draw: Draw, lines: Lines) -> Lines:
        damaged = lines.copy()
        for bit in distinct(draw, 8 * _LINE, len(lines), count).T:
            damaged[np.arange(len(lines)), bit // 8] ^= (1 << bit % 8).astype(np.uint8)
        return damaged

    return damage


def replace_bytes(longest: int) -> Damage:
    """1 to `longest` neighbouring bytes become random ones."""

    def damage(draw: Draw, lines: Lines) -> Lines:
        count = len(lines)
        length = 1 + draw.below(longest, count)
        first = draw.below(1 << 32, count) % (_LINE + 1 - length)
        at = np.arange(_LINE)
        hit = (at >= first[:, None]) & (at < (first + length)[:, None])
        return np.where(hit, draw.below(256, count, _LINE).astype(np.uint8), lines)

    return damage


def lose_byte(draw: Draw, lines: Lines) -> Lines:
    at, place = np.arange(_LINE - 1), draw.below(_LINE, len(lines), 1)
    return np.take_along_axis(lines, at + (at >= place), axis=1)


def double_byte(draw: Draw, lines: Lines) -> Lines:
    at, place = np.arange(_LINE + 1), draw.below(_LINE, len(lines), 1)
    return np.take_along_axis(lines, at - (at > place), axis=1)


def swap_bytes(draw: Draw, lines: Lines) -> Lines:
    at, place = np.arange(_LINE), draw.below(_LINE - 1, len(lines), 1)
    return np.take_along_axis(lines, at + (at == place) - (at == place + 1), axis=1)


def lose_22_bytes(draw: Draw, lines: Lines) -> Lines:
    """The head of one line and the tail of the next: as many bytes are missing between them as a line has."""
    at, place = np.arange(_LINE), 1 + draw.below(_LINE - 1, len(lines), 1)
    return np.where(at < place, lines, np.roll(lines, -1, axis=0))


KINDS: dict[str, Damage] = {
    "1 bit inverted": flip_bits(1),
    "2 bits inverted": flip_bits(2),
    "3 bits inverted": flip_bits(3),
    "1 byte replaced by a random one": replace_bytes(1),
    "1 to 4 neighbouring bytes replaced": replace_bytes(4),
    "1 byte lost": lose_byte,
    "1 byte doubled": double_byte,
    "2 neighbouring bytes swapped": swap_bytes,
    "22 bytes lost from within one line into the next": lose_22_bytes,
}


RARE = ("2 bits inverted", "3 bits inverted")


def residuals(kind: str, trials: int, seed: int) -> int:
    """Number of `trials` damaged lines that are accepted as a frame that was not sent."""
    draw, accepted = Draw(seed), 0
    for start in range(0, trials, _CHUNK):
        count = min(_CHUNK, trials - start)
        second, body = draw.below(256, count).astype(np.uint8), draw.below(256, count, 6).astype(np.uint8)
        lines = frame_lines(draw.below(0x800, count), second, body)
        damaged = KINDS[kind](draw, lines)
        ends = np.full((count, 1), ord("\r"), np.uint8)
        found, _ = parse(b"\r" + np.hstack([damaged, ends]).tobytes())
        if found:
            received = np.frombuffer(text_of_frames(found), f"S{_LINE}")
            accepted += int((~np.isin(received, lines.view(f"S{_LINE}"))).sum())
    return accepted


def residual_table(times: int = 1) -> str:
    """Markdown table of every kind of damage and its residual errors, with `times` the published number of trials."""
    lines = ["| damage to one line | lines damaged | accepted, not sent | per million |", "|---|---|---|---|"]
    for number, kind in enumerate(KINDS):
        trials = times * (RARE_TRIALS if kind in RARE else TRIALS)
        count = residuals(kind, trials, number)
        lines.append(f"| {kind} | {trials:,} | {count} | {count * 1e6 / trials:.0f} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--times", type=int, default=1, help="multiple of the published number of trials")
    print(residual_table(parser.parse_args().times), end="")


if __name__ == "__main__":
    main()
