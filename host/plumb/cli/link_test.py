"""Test a link: send samples in lockstep, one at a time and sixteen in flight; compare every digest and count losses.

    plumb link-test --board serial:/dev/ttyUSB0
    plumb link-test --board can:socketcan:can0 --steps 20000

The samples are random counts, so that every bit of the frames is used. The parameters stay as they are; a run in
progress is ended. Exit code 1 when a frame was lost, damaged or repeated, or a digest is wrong; 3 when the link broke.
"""

from __future__ import annotations

import argparse
import json
import time
from typing import TYPE_CHECKING, Any

from plumb.cli import options
from plumb.cli.whole_numbers import whole_number

if TYPE_CHECKING:
    from plumb.link.session import Session

ONE_AT_A_TIME = 500


def add_arguments(parser: argparse.ArgumentParser) -> None:
    options.add_board(parser, linked=True)
    parser.add_argument("--steps", type=whole_number, default=5000, help="steps sixteen in flight (default 5000)")
    options.add_seed(parser, "the counts")
    options.add_link_and_image(parser)
    options.add_json(parser)


def main(arguments: argparse.Namespace) -> int:
    from plumb.errors import UsageError, exit_code_of

    if not 1 <= arguments.steps <= 1_000_000:
        raise UsageError(f"--steps {arguments.steps}: give a number from 1 to 1000000")
    if arguments.seed < 0:
        raise UsageError(f"a seed is 0 or more, not {arguments.seed}")
    with options.linked_board_of(arguments) as board:
        result = tried(board.session, arguments.steps, arguments.seed)
    print(json.dumps(result) if arguments.json else describe(result))
    return exit_code_of(result["verdict"])


def tried(session: Session, steps: int, seed: int) -> dict[str, Any]:
    """Run the test; returns latencies, rates and losses. Raises LinkError if the link breaks."""
    import numpy as np

    from plumb.contract import run_fixed
    from plumb.contract.parameters import ControlParams
    from plumb.link.lockstep import Lockstep
    from plumb.proof.compare import count_mismatches
    from plumb.spec.parameters import control_part

    control = ControlParams.from_words(control_part(session.read_parameters()))
    rng = np.random.default_rng(seed)
    raw = rng.integers(-32768, 32768, (ONE_AT_A_TIME + steps, 6)).astype(np.int16)
    setpoint = np.repeat(rng.integers(-(1 << 31), 1 << 31, len(raw) // 16 + 1), 16)[: len(raw)].astype(np.int32)
    run = Lockstep(session)
    before = board_counters(session)
    took_s, digests = [], []
    for counts, target in zip(raw[:ONE_AT_A_TIME].tolist(), setpoint[:ONE_AT_A_TIME].tolist(), strict=True):
        start = time.perf_counter()
        digests.append(run.exchange(tuple(counts), target).digest)
        took_s.append(time.perf_counter() - start)
    start = time.perf_counter()
    streamed = run.run(raw[ONE_AT_A_TIME:], setpoint[ONE_AT_A_TIME:])
    streamed_s = time.perf_counter() - start
    after = board_counters(session)
    session.end()
    expected = run_fixed.run_control(control, raw, setpoint).digests()
    received = np.concatenate([np.array(digests, np.uint32), streamed])
    counters = session.counters
    losses = {
        "wrong_digests": count_mismatches(expected, received),
        "host_lost": counters.lost,
        "host_rejected": session.frames.rejected,
        "repeated_requests": counters.repeated_requests,
        **{f"board_{name}": after[name] - before[name] & 0xFFFF for name in ("rejected", "lost", "dropped")},
    }
    milliseconds = np.array(took_s) * 1e3
    return {
        "verdict": "fail" if any(losses.values()) else "pass",
        "steps": len(raw),
        "exchanges_per_s": round(ONE_AT_A_TIME / sum(took_s), 1),
        "steps_per_s": round(steps / streamed_s, 1),
        "exchange_ms": {f"p{p}": round(float(np.percentile(milliseconds, p)), 3) for p in (50, 99, 100)},
        **losses,
    }


def board_counters(session: Session) -> dict[str, int]:
    """The board's own counters, from its next periodic report."""
    session.telemetry.pop("COUNTERS", None)
    report = session.listening.timeout(2.0)
    while "COUNTERS" not in session.telemetry and not report.over:
        session.receive(0.05)
    return session.telemetry.get("COUNTERS", {"rejected": 0, "lost": 0, "dropped": 0})


def describe(r: dict[str, Any]) -> str:
    p = r["exchange_ms"]
    lost = {name: value for name, value in r.items() if isinstance(value, int) and name != "steps" and value}
    return "\n".join(
        [
            f"{r['steps']} steps: {r['exchanges_per_s']}/s one at a time, {r['steps_per_s']}/s sixteen in flight",
            f"an exchange takes {p['p50']} ms (median), 99 % within {p['p99']}, all within {p['p100']}",
            "nothing lost, damaged or repeated" if not lost else "; ".join(f"{n} {v}" for n, v in lost.items()),
            r["verdict"],
        ]
    )
