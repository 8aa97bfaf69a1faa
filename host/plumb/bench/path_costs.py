"""Costs of many paths through the same basic blocks: a block is computed once for each state that it is entered in."""

from __future__ import annotations

from collections.abc import Container, Sequence
from typing import NamedTuple

from plumb.bench.m3_timing import Cost, Instruction, Pipeline, State, steps_cost

Block = Sequence[Instruction]


class _Passed(NamedTuple):
    """Cost that a block adds to a path, and the state that it leaves. grown: growth of the stack at its end, bytes."""

    cost: Cost
    grown: int
    state: State


class PathCosts:
    """The same costs as `m3_timing.path_cost`. unit_writes: addresses of the stores to the CRC unit."""

    def __init__(self, unit_writes: Container[int] = ()) -> None:
        self._pipeline = Pipeline(unit_writes)
        self._start = self._pipeline.state
        self._passed: dict[tuple[int, int, int, int, State], _Passed] = {}

    def of(self, blocks: Sequence[Block]) -> Cost:
        """Cost of a path that ends with the return to the caller."""
        state, before = self._start, None
        instructions = cycles = cycles_2ws = stack = depth = 0
        for block, following in zip(blocks, [*blocks[1:], ()], strict=True):
            behind = following[0] if following else None
            passed = self._pass(block, before, behind, state)
            instructions += passed.cost.instructions
            cycles += passed.cost.cycles
            cycles_2ws += passed.cost.cycles_2ws
            stack = max(stack, depth + passed.cost.stack)
            depth += passed.grown
            state, before = passed.state, block[-1]
        return Cost(instructions, cycles, cycles_2ws, stack)

    def _pass(self, block: Block, before: Instruction | None, behind: Instruction | None, state: State) -> _Passed:
        around = [-1 if one is None else one.address for one in (before, behind)]
        key = block[0].address, len(block), around[0], around[1], state
        if key not in self._passed:
            self._pipeline.restore(state)
            steps = list(self._pipeline.steps(block, before, behind))
            self._passed[key] = _Passed(steps_cost(steps), steps[-1].stack, self._pipeline.state)
        return self._passed[key]
