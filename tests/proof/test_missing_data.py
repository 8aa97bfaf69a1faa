"""A run of which frames were lost on the way: what was received is compared, and the rest is said to be unverified."""

from __future__ import annotations

import json
import random
from collections.abc import Collection

import numpy as np
import pytest

from plumb.boards.native.board import NativeBoard
from plumb.contract.parameters import quantise
from plumb.errors import ExitCode, exit_code_of
from plumb.link.realtime import Capture
from plumb.link.session import Session
from plumb.link.transports.slcan_bus import PlumbBus
from plumb.proof.live_run import received
from plumb.proof.runs import Run, RunInputs, judge, prescribed
from plumb.systems.quad import scenarios as quad
from support.native_board import UartBoard

STEPS = 300


def judged(lost_raw: Collection[int], lost_digests: Collection[int], wrong: Collection[int] = ()) -> Run:
    """A run on the native board as a host receives it without those frames. wrong: steps whose digest is false."""
    whole = prescribed(quad.scenario("motion", 3, seconds=6.0))
    params = quantise(quad.TUNINGS["adaptive"])
    answer = NativeBoard().run_injected(params, whole.raw[:STEPS], whole.setpoint[:STEPS])
    with Session(PlumbBus(UartBoard())) as session:
        capture = Capture(session)
        capture.steps = STEPS
        for step in range(STEPS):
            if step not in lost_raw:
                capture.raw[step] = whole.raw[step].tolist()
            if step not in lost_digests:
                capture.digest[step] = int(answer.digests[step]) ^ (step in wrong)
    raw = np.array([capture.raw.get(step, [0] * whole.raw.shape[1]) for step in range(STEPS)], np.int16)
    inputs = RunInputs(
        whole.time_s[:STEPS],
        {name: values[:STEPS] for name, values in whole.truth.items()},
        raw,
        whole.setpoint[:STEPS],
        whole.scored[:STEPS],
    )
    return judge(None, inputs, params, received(capture, STEPS, None))


@pytest.mark.parametrize("seed", range(6))
def test_lost_frames_are_unverified_and_no_mismatch(seed: int) -> None:
    rng = random.Random(seed)
    lost_raw = rng.sample(range(20, STEPS), rng.choice([0, 1, 4]))
    lost_digests = rng.sample(range(20, STEPS), rng.choice([0, 1, 4]) if lost_raw else 2)
    run = judged(lost_raw, lost_digests)
    first = min([*lost_raw, *lost_digests])
    assert (run.mismatches, run.verdict, run.divergence) == (0, "unverified", None)
    said = json.loads(json.dumps(run.summary(scenario="motion")))
    assert (said["verdict"], said["bit_exact"], said["unverified_from_step"]) == ("unverified", None, first)
    assert said["metrics"]["target_vs_fixed_mismatches"] == 0
    assert exit_code_of(run.verdict) is ExitCode.LINK_TROUBLE
    assert f"unverified from step {first} on: frames were lost" in run.statements({"scenario": "motion"})[0].text


@pytest.mark.parametrize("seed", range(4))
def test_a_difference_that_was_received_fails_all_the_same(seed: int) -> None:
    rng = random.Random(seed)
    lost_digest, lost_raw = sorted(rng.sample(range(20, STEPS), 2))
    before = rng.choice([step for step in range(lost_raw) if step != lost_digest])
    run = judged([lost_raw], [lost_digest], [before])
    assert (run.mismatches, run.verdict) == (1, "fail")
    assert run.divergence is not None and run.divergence.step == before
    after = judged([lost_raw], [lost_digest], [rng.randrange(lost_raw, STEPS)])
    assert (after.mismatches, after.verdict) == (0, "unverified")
