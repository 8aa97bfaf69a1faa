"""Random numbers of the golden vectors: the same with every version of every library."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TypeVar

import numpy as np
import numpy.typing as npt

UInt64Array = npt.NDArray[np.uint64]
T = TypeVar("T")


def random_bits(seed: int, count: int, stream: int = 0) -> UInt64Array:
    """SplitMix64 (Steele, Lea, Flood 2014)."""
    mix = np.arange(1, count + 1, dtype=np.uint64)
    with np.errstate(over="ignore"):
        mix = mix * np.uint64(0x9E3779B97F4A7C15) + np.uint64((seed * 1_000_003 + stream * 7919) % 2**64)
        mix = (mix ^ (mix >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        mix = (mix ^ (mix >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return mix ^ (mix >> np.uint64(31))


class Draw:
    """A sequence of random numbers."""

    def __init__(self, seed: int) -> None:
        self._seed, self._stream = seed, 0
        self._left: Iterator[int] = iter(())

    def bits(self) -> int:
        """64 random bits."""
        for value in self._left:
            return value
        self._stream += 1
        self._left = iter(random_bits(self._seed, 4096, self._stream).tolist())
        return next(self._left)

    def below(self, end: int) -> int:
        """0 to `end` - 1."""
        return (self.bits() >> 8) % end

    def chance(self, of_1000: int) -> bool:
        return self.below(1000) < of_1000

    def of(self, choices: Sequence[T]) -> T:
        return choices[self.below(len(choices))]
