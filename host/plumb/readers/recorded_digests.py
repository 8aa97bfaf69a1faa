"""Compare the digests of a recorded run with those of the integer model and of a board, part by part."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from plumb.boards.contract import ChangesParameters, PartRunner, RunsInParts, StepBoard
from plumb.contract import run_fixed
from plumb.contract.parameters import Change, Changes, ControlParams
from plumb.proof.compare import Divergence
from plumb.readers.logged_runs import LoggedRun, Steps
from plumb.spec import dbc, declarations
from plumb.spec.records import Words

Digests = npt.NDArray[np.uint32]
BAR_STEPS = 1 << 18
"""With more steps, the comparison shows a progress bar."""


@dataclass
class Compared:
    """Answers that were compared with the model: compared: how many; differ: how many of them differ; divergence: the
    first of those."""

    compared: int = 0
    differ: int = 0
    divergence: Divergence | None = None

    def recorded(self, part: Steps, words: Words) -> None:
        """Compare the recorded digests of a part with the words of the model; the first that differs is traced to a
        signal, if one was recorded."""
        expected, known = words.digests(), part.digest_known
        self._note(part.first, expected, part.digest, known)
        if self.divergence is not None and self.divergence.signal == "digest" and self.divergence.step >= part.first:
            step = self.divergence.step - part.first
            self.divergence = _first_signal(part, words, step) or self.divergence

    def answered(self, first: int, expected: Digests, actual: Digests) -> None:
        """Compare the digests of a board, from step `first` on."""
        self._note(first, expected, actual, np.ones(len(actual), np.bool_))

    def _note(self, first: int, expected: Digests, actual: Digests, known: npt.NDArray[np.bool_]) -> None:
        differs = np.flatnonzero(known & (actual != expected))
        self.compared += int(np.count_nonzero(known))
        self.differ += len(differs)
        if len(differs) and self.divergence is None:
            at = int(differs[0])
            self.divergence = Divergence(first + at, 0, "digest", int(expected[at]), int(actual[at]))


@dataclass
class LongReplay:
    """A run that is too long to be held in memory: the recording and the board, each compared with the model.
    board_until: the first step that the board did not run, and why."""

    recorded: Compared = field(default_factory=Compared)
    board: Compared = field(default_factory=Compared)
    board_until: int | None = None
    why: str = ""


def replay_long(run: LoggedRun, steps: int, params: ControlParams, changes: Changes, board: StepBoard) -> LongReplay:
    """Run the first `steps` steps of a recorded run on the model and on a board."""
    from tqdm import tqdm

    found = LongReplay()
    model, answers = run_fixed.Controller(params), _answers(found, run, steps, params, changes, board)
    left = list(changes)
    hidden = None if steps > BAR_STEPS else True
    with tqdm(total=steps, desc=board.name, unit="step", leave=False, disable=hidden) as bar:
        for part in run.parts(steps):
            counts, setpoints = run_fixed.check_inputs(params.system, part.raw, part.setpoint)
            data = []
            for piece in pieces_between(part, left):
                if isinstance(piece, ControlParams):
                    model.retune(piece)
                else:
                    data.append(model.records(counts[piece], setpoints[piece]))
            words = Words.from_bytes(b"".join(data), (len(part),), params.system)
            found.recorded.recorded(part, words)
            answer = next(answers)
            found.board.answered(part.first, words.digests()[: len(answer)], answer)
            bar.update(len(part))
    answers.close()
    if found.board_until is None and found.board.compared < steps:
        found.board_until, found.why = found.board.compared, f"{board.name} gave no answer to it"
    return found


def pieces_between(part: Steps, left: list[Change]) -> Iterator[slice | ControlParams]:
    """The steps of a part between the changes, and these; what was given is taken from `left`."""
    begin = 0
    while left and left[0][0] < part.first + len(part):
        step, params = left.pop(0)
        if step - part.first > begin:
            yield slice(begin, step - part.first)
            begin = step - part.first
        yield params
    yield slice(begin, len(part))


def _answers(
    found: LongReplay, run: LoggedRun, steps: int, params: ControlParams, changes: Changes, board: StepBoard
) -> Generator[Digests]:
    """The digests of a board for each part of the run; fewer, or none, where it did not run the steps."""
    if changes and not isinstance(board, ChangesParameters):
        found.board_until = changes[0].step
        found.why = f"{board.name} takes no other parameters in lockstep; native, fixed and qemu do"
    if isinstance(board, RunsInParts):
        yield from _in_parts(found, run, steps, changes, board.part_runner(params))
        return
    parts = list(run.parts(steps))
    raw, setpoint = (np.concatenate([getattr(part, name) for part in parts]) for name in ("raw", "setpoint"))
    lengths = [len(part) for part in parts]
    del parts
    whole = slice(found.board_until)
    if changes and isinstance(board, ChangesParameters):
        digests = board.run_changed(params, changes, raw, setpoint).digests
    else:
        digests = board.run_injected(params, raw[whole], setpoint[whole]).digests
    for end, length in zip(np.cumsum(lengths).tolist(), lengths, strict=True):
        yield digests[end - length : end]


def _in_parts(found: LongReplay, run: LoggedRun, steps: int, changes: Changes, runner: PartRunner) -> Iterator[Digests]:
    left = [] if found.board_until is not None else list(changes)
    try:
        for part in run.parts(steps):
            digests = []
            end = len(part) if found.board_until is None else max(0, min(len(part), found.board_until - part.first))
            for piece in pieces_between(part.cut(end), left) if end else ():
                if isinstance(piece, ControlParams):
                    runner.change(piece)
                else:
                    digests.append(runner.run(part.raw[:end][piece], part.setpoint[:end][piece]))
            yield np.concatenate([np.zeros(0, np.uint32), *digests])
    finally:
        runner.end()


def _first_signal(recorded: Steps, words: Words, step: int) -> Divergence | None:
    """The first recorded signal of a step that is not what its word says; None when all agree, or none was recorded."""
    system = declarations.system(words.system)
    for frame in system.frames:
        for part, bits in ((frame.half, 16), (frame.word, 32)):
            if part is None:
                continue
            values, came = recorded.signal((dbc.frame_name(system, frame), part.name))
            if not came[step]:
                continue
            expected = int(words[part.word.name][step]) >> part.shift
            signed = part.word.type.startswith("int")
            if bits == 16:
                low, high = (-(1 << 15), (1 << 15) - 1) if signed else (0, (1 << 16) - 1)
                expected = min(max(expected, low), high)
            if expected & (1 << bits) - 1 != int(values[step]) & (1 << bits) - 1:
                return Divergence(recorded.first + step, 0, part.name, expected, int(values[step]))
    return None
