"""Files of a phone's apps that are hostile by structure: each is one sentence or a result, in time and memory."""

from __future__ import annotations

import json
import os
import random
from pathlib import Path

import pytest

from plumb.errors import UsageError
from plumb.judging.phone.inputs.udp import steps_of_file
from support.campaigns import campaign
from support.hostile_files import CONFUSED, deep, spoilt
from support.hostile_trial import BLOCK, WHOLE, try_block

PERIOD_US = 5000


def datagrams(rng: random.Random) -> bytes:
    """What a phone's apps send, with values of another type, times that jump, and lines without an end."""
    lines = []
    for number in range(rng.choice([3, 300, 2000])):
        stamp: object = rng.choice([number, number, number, number * 200, 0, 10**5 - number]) * 5_000_000
        values: object = [0.1, 0.2, 9.8]
        if rng.random() < 0.05:
            stamp, values = rng.choice([stamp, *CONFUSED]), rng.choice([values, *CONFUSED, [1e308] * 3, ["1"] * 3])
        kind = rng.choice(["android.sensor.gyroscope", "android.sensor.accelerometer"])
        if rng.random() < 0.5:
            lines.append(json.dumps({"type": kind, "timestamp": stamp, "values": values}))
        elif rng.random() < 0.9:
            lines.append(f"{number * 0.005}, 3, 0.1,9.8,-0.05, 4, 0.0,0.0,{rng.choice([0, 'nan', '1e999', ''])}")
        else:
            lines.append(rng.choice([deep(rng, "[", "]"), '{"type":' * 500, "A, 1, 2, 3", "3," * 3000, "\0" * 50]))
    return spoilt(rng, rng.choice(["\n", "\n", "", "\r"]).join(lines).encode())


@pytest.mark.slow
@pytest.mark.parametrize("block", range(campaign(1, WHOLE // BLOCK)))
def test_a_hostile_file_is_one_sentence_or_a_result(block: int, tmp_path: Path) -> None:
    try_block(
        tmp_path / "a.log",
        block,
        lambda seed: datagrams(random.Random(f"phone {seed}")),
        lambda path: steps_of_file(path, PERIOD_US),
    )


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
def test_a_pipe_is_refused_before_it_is_opened(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "a.log")
    with pytest.raises(UsageError):
        steps_of_file(tmp_path / "a.log", PERIOD_US)
