"""The step of `attitude`: every bit on both hands, and what holds for any input."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache

import numpy as np
import numpy.typing as npt
import pytest

from plumb.boards.native import core as native_core
from plumb.contract import run_fixed
from plumb.contract.parameters import ControlParams, quantise
from plumb.proof.compare import first_divergence
from plumb.proof.golden_recipe import WILD
from plumb.spec import declarations
from plumb.spec.records import RECORDS, Words, names_of
from plumb.systems.attitude import scenarios as attitude
from plumb.systems.attitude.fixed_state import AttitudeState
from plumb.systems.attitude.settings import Motion, Rest
from plumb.systems.attitude.tuning import AttitudeTuning, Mounting
from support.each_run import run_each
from support.wild_params import wild_attitude_params

Counts = npt.NDArray[np.int16]

RUNS, STEPS = 60, 260
NONE, ONE_G = -32768, 2048
FLAGS = {flag.name: 1 << bit for bit, flag in enumerate(declarations.system("attitude").flags)}
ALL_FLAGS = (1 << len(FLAGS)) - 1
QUICK = replace(attitude.DEFAULT, rest=Rest(seconds=0.3))
"""Rest and restart come within the few seconds of these runs."""
SURE = replace(QUICK, motion=Motion(start_tilt_deg=0.5))
"""A start near the vertical: what contradicts it is not learned at once."""
MISALIGNED = Mounting.of([[0.02, -0.98, 0.05], [1.01, 0.01, -0.03], [0.04, 0.02, 0.99]])
TURNED = Mounting.of([[0, 0, 1], [1, 0, 0], [0, 1, 0]])


def run(params: ControlParams, raw: Counts) -> Words:
    return native_core.run_control(params, raw, np.zeros((len(raw), *raw.shape[2:]), np.int32))


def both(params: ControlParams, raw: Counts) -> Words:
    """The words of both hands, which are the same."""
    words = run_fixed.run_control(params, raw, np.zeros(len(raw), np.int32))
    assert first_divergence(words, run(params, raw)) is None
    return words


def up(words: Words) -> npt.NDArray[np.float64]:
    """(steps, 3)"""
    return np.stack([words[f"up_q30_{axis}"] / 2.0**30 for axis in range(3)], axis=-1)


def held(*parts: tuple[int, tuple[int, ...]]) -> Counts:
    """Steps of the same sample: (how many, six counts)."""
    return np.concatenate([np.tile(np.array(counts, np.int16), (steps, 1)) for steps, counts in parts])


@lru_cache(maxsize=1)
def wild_runs() -> tuple[tuple[ControlParams, ...], Counts]:
    """Counts of any value, in some runs only the extremes, in some held for a while, in some small; in most of them
    samples are missing. The last run rests, and then lies on its side."""
    rng = np.random.default_rng(64)
    params = (*(wild_attitude_params(rng) for _ in range(RUNS - 1)), quantise(SURE))
    raw = rng.integers(-32768, 32768, (STEPS, 6, RUNS)).astype(np.int16)
    part = RUNS // 5
    raw[:, :, :part] = rng.choice(np.array([NONE, -32767, 0, 1, 32767], np.int16), (STEPS, 6, part))
    raw[:, :, part : 2 * part] = raw[np.arange(STEPS) // 40 * 40][:, :, part : 2 * part]
    raw[:, :, 2 * part : 3 * part] //= 500
    raw[:, :, 3 * part : 4 * part] //= 30
    missing = rng.random((STEPS, RUNS)) < rng.choice([0.0, 0.1, 0.8], RUNS)
    raw[:, 0] = np.where(missing, NONE, raw[:, 0])
    raw[:, :, -1] = held((100, (0, 0, 0, 0, 0, ONE_G)), (STEPS - 100, (0, 0, 0, ONE_G, 0, 0)))
    return params, raw


def test_wild_parameters_are_valid() -> None:
    assert all(native_core.params_valid(params) for params in wild_runs()[0])


def test_wild_runs_agree_in_every_bit() -> None:
    params, raw = wild_runs()
    setpoint = np.random.default_rng(61).integers(-(1 << 31), 1 << 31, (STEPS, RUNS)).astype(np.int32)
    model = run_each(params, raw, setpoint)
    assert first_divergence(model, native_core.run_control(params, raw, setpoint)) is None
    assert np.bitwise_or.reduce(model["flags"], axis=None) == ALL_FLAGS


@pytest.mark.parametrize("limit", [1 << 30, -(1 << 30)])
def test_largest_correction_of_a_bias_at_its_limit_keeps_it_there(limit: int) -> None:
    """Their sum does not fit 32 bits. Both are written into the states of both hands, where the block has ended."""
    params, rest = quantise(QUICK), (0, 0, 0, 0, 0, ONE_G)
    core, model = native_core.Controller(params), run_fixed.Controller(params)
    blocks = 0
    while blocks < 6:
        core.step(rest, 0)
        blocks += model.step(rest, 0)["block_step"] == 0
    words, size = core._memory.view(np.int32), RECORDS["attitude"].itemsize // 4
    assert words[:size].tobytes() == model.record(), "the state begins with the record; the covariance has 55 words"
    words[names_of("attitude").index("bias_turnps_q32_0")] = limit
    words[size + 55] = limit + limit - (limit > 0)
    state = model._c
    assert isinstance(state, AttitudeState)
    state.bias_turnps_q32[0], state.errors.correction_q28[0] = limit, limit + limit - (limit > 0)
    assert core.step(rest, 0) == model.step(rest, 0)
    assert state.bias_turnps_q32[0] == limit


@pytest.mark.parametrize("period_us", [1_000, 3_500, 21_000], ids=["1000Hz", "286Hz", "48Hz"])
@pytest.mark.parametrize("name", ["hand", "fast"])
def test_motion_agrees_in_every_bit(name: str, period_us: int) -> None:
    drawn = attitude.scenario(name, 5, seconds=max(3.0, 500 * period_us * 1e-6), period_us=period_us)
    words = both(quantise(drawn.fit(QUICK)), drawn.counts()[:1000])
    assert np.any(words["scale_q32_2"] != 0), "the filter has corrected"


@pytest.mark.parametrize("mounting", [TURNED, MISALIGNED], ids=["axes", "misaligned"])
def test_mounted_sensors_agree_in_every_bit(mounting: Mounting) -> None:
    drawn = attitude.scenario("hand", 6, seconds=3.0)
    mounted = quantise(replace(drawn.fit(QUICK), gyro_mounting=mounting, accel_mounting=mounting))
    words = both(mounted, drawn.counts())
    body = np.array(mounting.matrix) @ drawn.vertical[:, 0]
    assert up(words)[0] == pytest.approx(body / np.linalg.norm(body), abs=0.05)


@pytest.mark.parametrize("kind", WILD)
def test_wild_counts_agree_in_every_bit(kind: str) -> None:
    both(quantise(QUICK), WILD[kind](9, 700)[0].astype(np.int16))


def clipped(tuning: AttitudeTuning) -> AttitudeTuning:
    """Both sensors of short range: 60 deg/s, 1 g."""
    gyro = replace(tuning.gyro, min_counts=-984, max_counts=984)
    return replace(tuning, gyro=gyro, accel=replace(tuning.accel, min_counts=-ONE_G, max_counts=ONE_G))


def with_gaps(raw: Counts) -> Counts:
    lost = np.random.default_rng(62).random(len(raw)) < 0.1
    lost[:7] = lost[300:330] = True
    raw[lost] = NONE
    return raw


def with_rates_alone(raw: Counts) -> Counts:
    """In all kinds of places of a block: at the start, for a while, for one step, next to a gap."""
    raw = with_gaps(raw)
    for begin, end in ((7, 40), (500, 700), (800, 801), (298, 332)):
        raw[begin:end, 3:] = NONE
    return raw


CASES: dict[str, tuple[str, Callable[[], Counts], AttitudeTuning]] = {
    "gaps": ("MISSING", lambda: with_gaps(attitude.scenario("hand", 7, seconds=3.0).counts()), QUICK),
    "clipped": ("GYRO_CLIPPED", lambda: attitude.scenario("fast", 8, seconds=3.0).counts(), clipped(QUICK)),
    "alone": ("ACCEL_CLIPPED", lambda: with_rates_alone(attitude.scenario("hand", 7, seconds=3.0).counts()), QUICK),
    "rest": ("REST", lambda: attitude.scenario("static", 9, seconds=3.0).counts(), QUICK),
    "fall": ("FALLING", lambda: held((300, (0,) * 6), (300, (0, 0, 0, 900, 0, 1800))), QUICK),
    "upset": ("FALLING", lambda: held((200, (0, 0, 0, 0, 0, ONE_G)), (200, (0, 0, 0, 0, 0, -ONE_G))), QUICK),
    "away": ("RESTARTED", lambda: held((200, (0, 0, 0, 0, 0, ONE_G)), (600, (0, 0, 0, 4 * ONE_G, 0, ONE_G))), QUICK),
}


@pytest.mark.parametrize("name", CASES)
def test_what_seldom_happens_agrees_in_every_bit(name: str) -> None:
    flag, raw, tuning = CASES[name]
    assert np.any(both(quantise(tuning), raw())["flags"] & FLAGS[flag])


def test_quaternions_keep_their_length() -> None:
    params, raw = wild_runs()
    words = native_core.run_control(params, raw, np.zeros((STEPS, RUNS), np.int32))
    length = np.sqrt(sum((words[f"attitude_{axis}_q30"] / 2.0**30) ** 2 for axis in "wxyz"))
    assert np.abs(length - 1.0).max() < 1e-3


@pytest.mark.parametrize("inclined", [(0, 0, 1), (1, 0, 0), (0, -1, 0), (0.6, 0, 0.8), (-0.48, 0.64, -0.6), (0, 0, -1)])
def test_the_first_sample_says_what_is_up(inclined: tuple[float, float, float]) -> None:
    counts = [round(ONE_G * share) for share in inclined]
    words = run(quantise(attitude.DEFAULT), held((300, (0, 0, 0, counts[0], counts[1], counts[2]))))
    assert np.abs(up(words) - inclined).max() < 1e-3
    aligning = (words["flags"] & FLAGS["ALIGNING"]) != 0
    assert aligning[0] and not aligning[100:].any(), "aligned after four blocks, 0.5 s"


def test_without_weight_nothing_is_up_until_something_is_felt() -> None:
    words = run(
        quantise(attitude.DEFAULT), held((10, (0,) * 6), (1, (0, 0, 0, 0, 200, 0)), (20, (0, 0, 0, ONE_G, 0, 0)))
    )
    assert np.all(up(words)[:11] == [0, 0, 1]), "0.1 g is too little"
    assert np.abs(up(words)[11:] - [1, 0, 0]).max() < 0.01


def test_the_attitude_turns_by_the_rate_also_without_samples() -> None:
    """36.6 deg/s about x for 100 steps, of which only the first has a sample."""
    words = run(quantise(attitude.DEFAULT), held((1, (600, 0, 0, 0, 0, ONE_G)), (99, (NONE, 0, 0, 0, 0, 0))))
    turned = np.degrees(2.0 * np.arctan2(words["attitude_x_q30"], words["attitude_w_q30"]))
    assert turned[22] == pytest.approx(23 * 0.005 * 600 / 16.4, rel=1e-3)
    assert words["missing_steps"][-1] == 99 and np.all(words["rate_turnps_q28_0"][:23] == words["rate_turnps_q28_0"][0])


@pytest.mark.parametrize("seed", range(3))
def test_after_wild_counts_rest_shows_what_is_up(seed: int) -> None:
    wild = WILD["uniform"](seed, 2000)[0].astype(np.int16)
    words = run(quantise(attitude.DEFAULT), np.concatenate([wild, held((6000, (0, 0, 0, 0, ONE_G, 0)))]))
    assert up(words)[-1] == pytest.approx([0, 1, 0], abs=0.01)


def test_a_body_that_has_moved_away_starts_again_with_its_heading_and_its_count_of_steps() -> None:
    raw = CASES["away"][1]()
    words = run(quantise(QUICK), raw)
    began = int(np.flatnonzero(words["flags"] & FLAGS["RESTARTED"])[0])
    assert words["flags"][began] & FLAGS["ALIGNING"] and words["step"][began] == began + 1
    for name in ("bias_turnps_q32_0", "scale_q32_1", "velocity_gs_q28_0", "velocity_square_g2s2_q24"):
        assert words[name][began] == 0 and (name[:4] != "velo" or words[name][began - 1] != 0)
    assert np.all(up(words)[began + 1] == up(words)[began]), "no sample alone turns an attitude that is not level"
    assert up(words)[began + 24] == pytest.approx(np.array([4, 0, 1]) / np.sqrt(17), abs=1e-3)


@pytest.mark.parametrize(
    "change",
    [
        {"gyro.gain": 1 << 30},
        {"accel.gain": 1 << 30},
        {"gyro_mounting.xx_q30": 0},
        {"accel_mounting.zy_q30": 1 << 30},
        {"attitude.block_steps": 64},
        {"attitude.block_steps": 14},
        {"attitude.half_angle": (1 << 34) // 24 + 1},
    ],
    ids=lambda change: " ".join(change),
)
def test_what_would_overflow_is_refused_by_the_core(change: dict[str, int]) -> None:
    params = quantise(attitude.DEFAULT)
    assert native_core.params_valid(params)
    assert not native_core.params_valid(replace(params, values={**params.values, **change}))
