"""Cycles of the steps of the compared systems over recordings, in the Arm code of the image: `plumb bench --recording`.

The inputs are those of `plumb compare` as recorded; every step of every recording counts.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from plumb import systems
from plumb.analyses.comparison.contenders import COMPARE
from plumb.analyses.comparison.samples import SIXTEEN_BITS, motion_of, sampled
from plumb.bench.bench import StepDriver
from plumb.bench.instruction_counter import Counter, Image
from plumb.readers import recording
from plumb.spec import declarations

CHUNK = 500
"""Steps between two calls of `done`."""


@dataclass(frozen=True)
class Load:
    """Cycles of a step of a system over one recording at zero wait states, mean and worst, and how many steps."""

    system: str
    recording: str
    cycles_mean: float
    cycles_max: int
    steps: int

    def line(self) -> str:
        return (
            f"{self.system} over {self.recording}: {self.cycles_mean:.0f} cycles in the mean, {self.cycles_max} in the "
            f"worst of {self.steps} steps"
        )


def compared_systems() -> list[str]:
    """The systems that can be compared on recordings and have a budget of the mean step."""
    return [name for name in systems.with_part(COMPARE.name) if declarations.system(name).cycles_mean is not None]


def loads(image: Path, paths: Sequence[Path], done: Callable[[int], object]) -> list[Load]:
    """One for every system and recording. done: called with the number of steps that were counted. Raises UsageError
    for a recording that cannot be compared."""
    motions = [motion_of(recording.load(path)) for path in paths]
    elf, found = Image(image), []
    for name in compared_systems():
        part = systems.load(name, COMPARE)
        for motion in motions:
            samples = sampled(motion, SIXTEEN_BITS, 1)
            counter = Counter(elf, ["control_step"])
            driver = StepDriver(counter)
            driver.begin(part.params(samples))
            for at in range(0, len(samples.counts), CHUNK):
                rows = samples.counts[at : at + CHUNK].tolist()
                for counts in rows:
                    driver.step(counts, 0)
                done(len(rows))
            profile = counter.profiles["control_step"]
            mean = profile.cycles_sum / profile.calls
            found.append(Load(name, motion.name, mean, profile.cycles_max, profile.calls))
    return found


def within_budget(found: Sequence[Load]) -> bool:
    """Whether the mean over all recordings, and the worst step of each, keep the declared budgets."""
    for name in {one.system for one in found}:
        own, budget = [one for one in found if one.system == name], declarations.system(name)
        steps = sum(one.steps for one in own)
        mean = sum(one.cycles_mean * one.steps for one in own) / steps
        if budget.cycles_mean is not None and mean > budget.cycles_mean:
            return False
        if budget.cycles is not None and max(one.cycles_max for one in own) > budget.cycles:
            return False
    return True
