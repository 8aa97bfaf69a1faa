"""A recording that is read block by block gives the same runs and steps as one that is sorted in one piece."""

from __future__ import annotations

import random
import tracemalloc
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from plumb.readers import log_replay, run_parts
from plumb.readers.log_file import FRAME, Frames, read_log
from plumb.readers.logged_runs import LoggedRun, runs_in
from plumb.readers.run_parts import PER_STEP
from plumb.readers.step_table import tables_of
from plumb.spec.protocol import protocol
from support.recordings import GAINS, log_of_zeros, recorded_run

MESSAGES = protocol()
STEER = 1 << 28
SCALARS = (
    "at", "end", "first", "steps", "raw_frames", "raw_missing", "digest_missing", "incomplete", "setpoint_doubt",
    "begin_us", "lost", "table_frames", "marks",
)  # fmt: skip


@pytest.fixture(scope="module")
def frames(tmp_path_factory: pytest.TempPathFactory) -> Frames:
    """Three runs, the second of which changes its parameters and lasts longest."""
    folder = tmp_path_factory.mktemp("log")
    short = read_log(recorded_run(folder / "short.plog", 0.4)).frames
    long = read_log(recorded_run(folder / "long.plog", 2.0, setpoint=STEER, changes=[GAINS])).frames
    return np.concatenate([short, long, short[: len(short) * 3 // 4]])


def runs_by(frames: Frames, pieces: list[int], marks: tuple[int, ...] = ()) -> list[LoggedRun]:
    def blocks() -> Iterator[Frames]:
        begin = 0
        for piece in pieces:
            yield frames[begin : begin + piece]
            begin += piece
        yield frames[begin:]

    return runs_in(blocks, MESSAGES, lambda at: ("RAW_A",), marks)


def damaged(frames: Frames, rng: random.Random) -> Frames:
    """Frames lost, one by one and in a row, RUN_BEGIN missing, a pair swapped."""
    kept = np.ones(len(frames), np.bool_)
    kept[[rng.randrange(len(frames)) for _ in range(rng.choice([0, 3, 40]))]] = False
    begin = rng.randrange(len(frames))
    kept[begin : begin + rng.choice([0, 5, 300])] = False
    if rng.random() < 0.3:
        kept[frames["can_id"] == MESSAGES["ACK"].identifier] = False
    found = frames[kept].copy()
    at = rng.randrange(len(found) - 1)
    found[[at, at + 1]] = found[[at + 1, at]]
    return found[rng.choice([0, rng.randrange(200)]) :]


def same(one: LoggedRun, other: LoggedRun) -> None:
    for name in SCALARS:
        assert getattr(one, name) == getattr(other, name), name
    for name in PER_STEP:
        if name != "time_us":
            assert np.array_equal(getattr(one, name), getattr(other, name)), name
    assert set(one.signals) == set(other.signals)
    for signal, (values, came) in one.values.items():
        assert np.array_equal(values, other.values[signal][0]) and np.array_equal(came, other.values[signal][1])


@pytest.mark.parametrize("seed", range(8))
def test_the_pieces_make_no_difference(frames: Frames, seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = random.Random(seed)
    given = damaged(frames, rng) if seed else frames
    marks = tuple(sorted(rng.sample(range(len(given)), 5)))
    whole = runs_by(given, [], marks)
    assert len(whole) >= 2 and sum(run.steps for run in whole) > 50
    monkeypatch.setattr(run_parts, "WINDOW_FRAMES", rng.choice([3, 40, 400]))
    monkeypatch.setattr(run_parts, "PART_STEPS", rng.choice([2, 7, 1000]))
    pieces = [rng.randrange(1, 3 * run_parts.WINDOW_FRAMES + 2) for _ in range(len(given))]
    found = runs_by(given, pieces, marks)
    assert len(found) == len(whole)
    for one, other in zip(whole, found, strict=True):
        same(one, other)


def test_parts_are_bounded_and_in_order(frames: Frames, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run_parts, "WINDOW_FRAMES", 100)
    monkeypatch.setattr(run_parts, "PART_STEPS", 9)
    run = max(runs_by(frames, [50] * (len(frames) // 50)), key=lambda one: one.steps)
    parts = list(run.parts())
    assert len(parts) > run.steps // 9 and max(len(part) for part in parts) <= 9
    assert [part.first for part in parts] == np.cumsum([0, *(len(part) for part in parts[:-1])]).tolist()
    assert sum(len(part) for part in run.parts(20)) == 20 and sum(len(part) for part in parts) == run.steps


def measured(path: Path) -> tuple[int, int]:
    """The last step of a log by its table, and the largest memory that it took to get there."""
    tracemalloc.start()
    try:
        (recorded,) = log_replay.runs_of(log_replay.open_log(path))
        last = 0
        for columns in tables_of(recorded):
            last = int({column.name: column for column in columns}["step"].values[-1])
        return last, tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_a_log_of_hours_takes_no_more_memory_than_one_of_minutes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And the steps of a run are counted beyond the 16 bits of their number."""
    monkeypatch.setattr(run_parts, "WINDOW_FRAMES", 1 << 11)
    monkeypatch.setattr(run_parts, "PART_STEPS", 1 << 10)
    found = []
    for steps in (6_000, 66_000):
        log = log_of_zeros(tmp_path / f"{steps}.plog", steps)
        found.append(measured(log))
    (few, less), (many, more) = found
    # Eleven times the steps; what is kept for each would take ten times more. 1 MiB is the interpreter's own.
    assert (few, many) == (5_999, 65_999) and more < 1.3 * less + (1 << 20), found


def test_a_recording_of_hours_without_a_step_keeps_no_frames() -> None:
    """TIME frames alone: a reader that waits for a run holds none of them."""
    time = MESSAGES["TIME"]
    one = np.zeros(run_parts.WINDOW_FRAMES, FRAME)
    one["can_id"], one["length"] = time.identifier, 8
    one["data"] = np.frombuffer(time.pack(0, 0, 1, 2), np.uint8)
    reader = run_parts.RunReader(MESSAGES, lambda at: ("RAW_A",))
    assert not list(reader.parts([one] * 3)) and not len(reader._frames)
