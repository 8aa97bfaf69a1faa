"""Steps of published filters as Arm code: Mahony is what it says, and every cost is there."""

from __future__ import annotations

import importlib.util
import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from plumb.bench.instruction_counter import Counter

TOOL = Path(__file__).resolve().parents[2] / "tools" / "measure_published.py"
PERIOD_S, STEPS, LEAN_DEG = 0.0025, 400, 10.0


@pytest.fixture(scope="module")
def counter(tmp_path_factory: pytest.TempPathFactory) -> Counter:
    spec = importlib.util.spec_from_file_location("measure_published", TOOL)
    assert spec is not None and spec.loader is not None
    tool = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(tool)
    return Counter(tool.built(tmp_path_factory.mktemp("published")))


def lean_deg(counter: Counter) -> float:
    w, x, y, z = np.frombuffer(counter.read(counter.call("mahony_quaternion").result, 16), "<f4").astype(float)
    return math.degrees(math.atan2(2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)))


def test_mahony_in_arm_code_reaches_a_lean_as_its_gains_say(counter: Counter) -> None:
    """A small error e has e'' + k_P e' + k_I e = 0, and begins with e' = -k_P e."""
    counter.call("begin", round(1e6 * PERIOD_S))
    lean = math.radians(LEAN_DEG)
    acc = 9.80665 * np.array([0.0, math.sin(lean), math.cos(lean)])
    at = counter.place(np.array([0.0, 0.0, 0.0, *acc], "<f4").tobytes())
    for _ in range(STEPS):
        counter.call("mahony_step", at, at + 12)
    after_s, w = PERIOD_S * STEPS, math.sqrt(0.3 - 0.25)
    left = math.exp(-0.5 * after_s) * (math.cos(w * after_s) - 0.5 / w * math.sin(w * after_s))
    assert (LEAN_DEG - lean_deg(counter)) / LEAN_DEG == pytest.approx(left, rel=0.01)


def test_mahony_in_arm_code_follows_a_turn(counter: Counter) -> None:
    counter.call("begin", round(1e6 * PERIOD_S))
    rate = math.radians(90.0)
    at = counter.place(bytes(24))
    for step in range(1, STEPS + 1):
        turned = rate * PERIOD_S * step
        sample = [rate, 0.0, 0.0, 0.0, 9.80665 * math.sin(turned), 9.80665 * math.cos(turned)]
        counter.write(at, np.array(sample, "<f4").tobytes())
        counter.call("mahony_step", at, at + 12)
    assert lean_deg(counter) == pytest.approx(90.0, abs=0.5)


def test_every_filter_has_its_cost() -> None:
    command = [sys.executable, str(TOOL), "--seconds", "0.1", "--json"]
    cost = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    assert {"attitude", "VQF", "BasicVQF", "Mahony"} <= cost.keys()
    assert all(0 < one["mean"] <= one["worst"] for one in cost.values())
    assert cost["VQF"]["mean"] > cost["BasicVQF"]["mean"] > cost["Mahony"]["mean"] > cost["attitude"]["mean"]
