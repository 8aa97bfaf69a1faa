"""A recorded run of a board in memory, as a log and as the parts that a test damages."""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path

import numpy as np

from plumb.boards.contract import RawCounts, Setpoints
from plumb.contract import run_fixed
from plumb.contract.parameters import ControlParams
from plumb.files.block_file import Block, BlockWriter, read_blocks
from plumb.link import parameter_table
from plumb.link.session import Session
from plumb.link.transports.slcan_bus import PlumbBus
from plumb.readers.log_file import MAGIC, Frames, read_log
from plumb.spec import dbc, parameters
from plumb.spec.parameter_file import by_name
from plumb.spec.protocol import protocol
from plumb.writers.log_writer import LogWriter
from plumb.writers.recorder import Recorder
from support.native_board import UartBoard

FRAMES = ("RAW_A", "QUAD_ANGLE")
MOTION = ((1676, 2048, 3041), (1720, 2090, 3035), (1650, 2010, 3044), (1701, 1995, 3040))
"""Counts of the sensors, one after the other: the outputs change at every step."""


GAINS = {"pid.kp_q22": 4_000_000, "pid.ki_dt_q22": 90_000, "pid.kd_q27": 2_500_000}
"""Of a table that is committed in the middle of a run."""


def recorded_run(
    path: Path,
    seconds: float = 0.5,
    *,
    setpoint: int | None = None,
    late: bool = False,
    changes: Sequence[Mapping[str, int]] = (),
) -> Path:
    """A log of a live run of quad. setpoint: set in the middle. late: the recorder joins in the middle of the run.
    changes: parameters that are committed after the middle, one set after the other."""
    board = UartBoard()
    session = Session(PlumbBus(board))
    session.connect()
    if late:
        session.begin("REALTIME_LIVE", frames=FRAMES)
        _live(board, session, seconds / 2)
    recorder = Recorder(session, path, {"command": "a test"})
    session.listener = recorder.feed
    if not late:
        session.begin("REALTIME_LIVE", frames=FRAMES)
    _live(board, session, seconds / 2)
    if setpoint is not None:
        session.set_setpoint(setpoint)
    for values in changes:
        parameter_table.commit(session, {**by_name(session.read_parameters()), **values})
        _live(board, session, seconds / 2)
    _live(board, session, seconds / 2)
    session.listener = None
    session.end()
    recorder.close("done")
    return path


def _live(board: UartBoard, session: Session, seconds: float) -> None:
    end, turn = session.clock() + seconds, 0
    while session.clock() < end:
        board.sensors((*MOTION[turn % len(MOTION)], 0, 0, 0))
        turn += 1
        session.receive(0.007)


def log_of_counts(
    path: Path, params: ControlParams, counts: RawCounts, lost: Collection[int] = (), setpoint: Setpoints | None = None
) -> Path:
    """A log of a run with these inputs. lost: steps whose counts did not arrive. setpoint: of each step; None: 0."""
    messages, asked = protocol(), np.zeros(len(counts), np.int32) if setpoint is None else setpoint
    frames_of_raw = dbc.raw_frames(counts.shape[1])
    digests = run_fixed.run_control(params, counts, asked).digests().tolist()
    before, reports = 0, 0
    with LogWriter(path, {"command": "a test"}, simulated=True) as log:
        log.parameters(parameters.whole_table(params.words(), **params.link_words()))
        for step, (row, wanted, digest) in enumerate(zip(counts.tolist(), asked.tolist(), digests, strict=True)):
            said: list[tuple[str, tuple[int, ...]]] = [("STEP", (step & 15, 0, step & 0xFFFF, digest))]
            if wanted != before:
                said.append(("SETPOINT_USED", (reports & 15, 0, step & 0xFFFF, wanted)))
                before, reports = wanted, reports + 1
            for at, name in enumerate(frames_of_raw if step not in lost else ()):
                said.append((name, (step & 15, step >> 4 & 3, *row[3 * at : 3 * at + 3])))
            frames = [(messages[name].identifier, messages[name].pack(*words)) for name, words in said]
            log.add(frames, step * params.period_s)
    return path


def log_of_zeros(path: Path, steps: int) -> Path:
    """A long log, made quickly: STEP and RAW_A of each step, all counts and digests 0."""
    message = {name: protocol()[name] for name in ("STEP", "RAW_A")}
    with LogWriter(path, {"command": "a test"}, simulated=True) as log:
        log.parameters([row.default for row in parameters.table()])
        for step in range(steps):
            said = [("STEP", (step & 15, 0, step & 0xFFFF, 0)), ("RAW_A", (step & 15, step >> 4 & 3, 0, 0, 0))]
            log.add([(message[name].identifier, message[name].pack(*words)) for name, words in said], 0.02 * step)
    return path


def blocks_of(path: Path) -> list[Block]:
    return [one for one in read_blocks(path, MAGIC, "") if isinstance(one, Block)]


def rewritten(path: Path, out: Path, change: Callable[[str, bytes], bytes | None]) -> Path:
    """A log whose blocks a function (kind, payload) has changed; None leaves one out. The result is whole again."""
    with BlockWriter(out, MAGIC, replace=True) as blocks:
        for block in blocks_of(path):
            payload = change(block.kind, block.payload)
            if payload is not None:
                blocks.append(block.kind, payload)
    return out


def with_json(kind: str, change: Callable[[dict[str, object]], object]) -> Callable[[str, bytes], bytes]:
    """A change of the JSON of one kind of block, for `rewritten`."""

    def changed(found: str, payload: bytes) -> bytes:
        if found != kind:
            return payload
        value = json.loads(payload)
        change(value)
        return json.dumps(value).encode()

    return changed


def with_frames(path: Path, out: Path, change: Callable[[Frames], Frames]) -> Path:
    """A log whose frames, of all blocks together, a function has changed."""
    frames = change(read_log(path).frames.copy())
    left = [block.kind for block in blocks_of(path)].count("FRMS")

    def one_block(kind: str, payload: bytes) -> bytes | None:
        nonlocal left
        left -= kind == "FRMS"
        return payload if kind != "FRMS" else None if left else frames.tobytes()

    return rewritten(path, out, one_block)


def other_digest(step: int) -> Callable[[Frames], Frames]:
    """For with_frames: one bit of the digest of a step is another."""
    step_message = protocol()["STEP"]

    def change(frames: Frames) -> Frames:
        at = np.flatnonzero(frames["can_id"] == step_message.identifier)[step]
        sent = step_message.decode(frames["data"][at].tobytes())
        wrong = step_message.pack(step & 15, 0, step, sent["digest"] ^ 1)
        frames["data"][at] = np.frombuffer(wrong, np.uint8)
        return frames

    return change
