"""fixed and the C core agree in every bit of every word: wild runs, ordinary runs, and every kernel at its edges."""

from __future__ import annotations

from functools import lru_cache, partial

import numpy as np
import numpy.typing as npt
import pytest

from plumb.boards.native import core as native_core
from plumb.contract import run_fixed
from plumb.contract.parameters import ControlParams, quantise
from plumb.errors import UsageError
from plumb.kernels.fixed import kernels as fixed_kernels
from plumb.kernels.fixed import trig
from plumb.proof.compare import count_mismatches, first_digest_divergence, first_divergence
from plumb.spec.records import RECORDS, Words, names_of
from plumb.systems.quad import scenarios as quad
from support.each_run import agreed, each
from support.wild_params import wild_params

EDGES = np.array([sign * ((1 << n) + d) for n in range(32) for d in (-2, -1, 0, 1, 2) for sign in (-1, 1)], np.int64)
INT32 = np.unique(EDGES[(EDGES >= -(1 << 31)) & (EDGES < 1 << 31)])
RUNS, STEPS = 1600, 500


def wild_inputs(rng: np.random.Generator, steps: int, runs: int) -> tuple[npt.NDArray[np.int16], npt.NDArray[np.int32]]:
    """Counts and setpoints of any value, in some runs only the extremes, in some held for a while."""
    raw = rng.integers(-32768, 32768, (steps, 6, runs)).astype(np.int16)
    setpoint = rng.integers(-(1 << 31), 1 << 31, (steps, runs)).astype(np.int32)
    third = runs // 3
    raw[:, :, :third] = rng.choice(np.array([-32768, -1, 0, 1, 32767], np.int16), (steps, 6, third))
    held = np.arange(steps) // 40 * 40
    raw[:, :, third : 2 * third] = raw[held][:, :, third : 2 * third]
    setpoint[:, third : 2 * third] = setpoint[held][:, third : 2 * third]
    return raw, setpoint


@lru_cache(maxsize=1)
def wild_params_of_all_runs() -> tuple[ControlParams, ...]:
    rng = np.random.default_rng(20)
    return tuple(wild_params(rng) for _ in range(RUNS))


@pytest.mark.parametrize("system", RECORDS)
def test_the_words_have_the_same_names_and_order(system: str) -> None:
    assert native_core.word_names(native_core.c_core(), system) == names_of(system)
    assert names_of(system)[:6] == tuple(f"raw_{i}" for i in range(6)) and names_of(system)[-2:] == ("flags", "step")


def test_wild_parameters_are_valid() -> None:
    """Else the wild runs would prove nothing about what the firmware accepts."""
    assert all(native_core.params_valid(params) for params in wild_params_of_all_runs())


@pytest.mark.slow
def test_wild_runs_agree_in_every_bit() -> None:
    params, (raw, setpoint) = wild_params_of_all_runs(), wild_inputs(np.random.default_rng(21), STEPS, RUNS)
    model = agreed(params, raw, setpoint, begun=30, every=20)
    # wild enough: every flag, and both signs of every word that can have both
    assert np.bitwise_or.reduce(model["flags"]) == 15
    for name in names_of("quad"):
        if RECORDS["quad"][name].kind == "i" and name not in ("p00", "p11", "k0_q29"):
            assert model[name].min() < 0 < model[name].max(), name


@pytest.mark.slow
@pytest.mark.parametrize("name", quad.TUNINGS)
def test_ordinary_runs_agree_in_every_bit(name: str) -> None:
    params = quantise(quad.TUNINGS[name])
    runs = [quad.scenario(kind, seed) for kind in ("motion", "disturb") for seed in range(3)]
    raw = np.concatenate([run.counts() for run in runs])[:6000]
    setpoint = np.concatenate([run.setpoint() for run in runs])[:6000]
    whole = run_fixed.run_control(params, raw, setpoint)
    assert first_divergence(whole, native_core.run_control(params, raw, setpoint)) is None


def test_the_model_takes_one_run() -> None:
    raw, setpoint = wild_inputs(np.random.default_rng(22), 60, 3)
    with pytest.raises(UsageError, match="3 runs: give the integer model those of one run"):
        run_fixed.run_control(quantise(quad.TUNINGS["paper"]), raw, setpoint)


def test_step_by_step_is_the_same_run() -> None:
    params = quantise(quad.TUNINGS["adaptive"])
    raw, setpoint = wild_inputs(np.random.default_rng(23), 200, 1)
    words = run_fixed.run_control(params, raw[:, :, 0], setpoint[:, 0])
    for controller in (run_fixed.Controller(params), native_core.Controller(params)):
        for step, digest in enumerate(words.digests().tolist()):
            row = controller.step(raw[step, :, 0].tolist(), int(setpoint[step, 0]))
            assert row == dict(zip(words.names, words.record[step].item(), strict=True))
            assert controller.digest() == digest


def test_atan2_on_edges_and_at_random() -> None:
    y, x = (grid.ravel() for grid in np.meshgrid(INT32, INT32))
    rng = np.random.default_rng(24)
    wide = rng.integers(-(1 << 31), 1 << 31, (2, 200_000)) >> rng.integers(0, 31, (2, 200_000))
    for rows, columns in ((y, x), wide):
        assert np.array_equal(each(trig.atan2, rows, columns), native_core.atan2(rows, columns))


def test_asin_on_edges_and_at_random() -> None:
    rng = np.random.default_rng(25)
    near_one = (1 << 30) - (rng.integers(0, 1 << 30, 100_000) >> rng.integers(0, 30, 100_000))
    for sines in (INT32, rng.integers(-(1 << 31), 1 << 31, 100_000), near_one, -near_one):
        assert np.array_equal(each(trig.asin, sines), native_core.asin(sines))


def test_reciprocal() -> None:
    d = np.random.default_rng(26).integers(1 << 30, 1 << 31, 500_000)
    d[:4000] = np.concatenate([np.arange(2000) + (1 << 30), (1 << 31) - 1 - np.arange(2000)])
    assert np.array_equal(each(trig.reciprocal, d), native_core.reciprocal(d))


def test_tilt_and_its_variance() -> None:
    rng = np.random.default_rng(27)
    limit = 7 << 28
    y, z = np.clip(rng.integers(-(1 << 31), 1 << 31, (2, 2000)) >> rng.integers(0, 8, (2, 2000)), -limit, limit)
    y[:9], z[:9] = np.repeat([-limit, 0, limit], 3), np.tile([-limit, 0, limit], 3)
    for params in wild_params_of_all_runs()[:60]:
        turn, variance = native_core.tilt_and_trust(params, y, z)
        assert np.array_equal(each(partial(fixed_kernels.tilt_angle, params.values), y, z), turn)
        assert np.array_equal(each(partial(fixed_kernels.tilt_variance, params.values), y, z), variance)


def states(params: ControlParams, rng: np.random.Generator, n: int) -> npt.NDArray[np.void]:
    """Filter states that a run could be in, and most that it could not: p11, p00 and |p01| <= p00 of every size."""
    records = np.zeros(n, native_core.KALMAN_DTYPE)
    records["tilt_turn_q61"] = rng.integers(-(1 << 63), 1 << 63, n)
    records["bias_turn_q61"] = rng.integers(-(1 << 58), 1 << 58, n) >> rng.integers(0, 58, n)
    records["p00"] = rng.integers(0, 1 << 56, n) >> rng.integers(0, 56, n)
    records["p01"] = -(records["p00"] * rng.random(n)).astype(np.int64)
    records["p11"] = rng.integers(0, 1 << 56, n) >> rng.integers(0, 56, n)
    records["p11_frac_q30"] = rng.integers(0, 1 << 30, n)
    # p11 at its upper clamp, which no run reaches: it takes a p01 that leaves p11 nothing to fall by
    records["p00"][:9] = 1 << 56
    records["p01"][:9] = records["p11"][:9] = (1 << 56) - (1 << np.arange(9))
    return records


def test_kalman_step_on_unrelated_states() -> None:
    rng, n = np.random.default_rng(28), 500
    for params in wild_params_of_all_runs()[:100]:
        before = states(params, rng, n)
        r = np.clip((1 << 24) >> rng.integers(0, 25, n), 1, 1 << 24)
        z, u = rng.choice(INT32, n), rng.choice(INT32, n)
        after = native_core.kalman_step(params, before, r, z, u)
        for state, *measured, expected in zip(
            before.tolist(), r.tolist(), z.tolist(), u.tolist(), after.tolist(), strict=True
        ):
            k = fixed_kernels.KalmanState(*state)
            fixed_kernels.kalman_step(k, params.values, *measured)
            assert k.words() == expected


def test_pid_step_on_unrelated_states() -> None:
    rng, n = np.random.default_rng(29), 1000
    for params in wild_params_of_all_runs()[:100]:
        before = np.zeros(n, native_core.PID_DTYPE)
        before["integral_q54"] = rng.integers(-(1 << 54), 1 << 54, n) >> rng.integers(0, 54, n)
        before["rate_filtered_turnps_q27"] = rng.integers(-(1 << 30), 1 << 30, n)
        before["command_q22"] = rng.integers(-(1 << 22), 1 << 22, n)
        before["command_q22"][::2] ^= np.int32(1) << rng.integers(0, 31, n // 2).astype(np.int32)  # flipped bits
        error, rate = rng.choice(INT32, n), rng.choice(INT32, n)
        after = native_core.pid_step(params, before, error, rate)
        for state, one_error, one_rate, expected in zip(
            before.tolist(), error.tolist(), rate.tolist(), after.tolist(), strict=True
        ):
            c = fixed_kernels.PidState(*state)
            fixed_kernels.pid_step(c, params.values, one_error, one_rate)
            assert c.words()[:4] == expected[:4]


def test_digests_are_the_cores_own() -> None:
    params = quantise(quad.TUNINGS["paper"])
    raw, setpoint = wild_inputs(np.random.default_rng(30), 100, 1)
    words = native_core.run_control(params, raw[:, :, 0], setpoint[:, 0])
    assert words.digests().tolist() == [
        native_core.crc32(words.record[step : step + 1].tobytes()) for step in range(100)
    ]


def test_one_flipped_bit_is_found_and_named() -> None:
    params = quantise(quad.TUNINGS["paper"])
    raw, setpoint = wild_inputs(np.random.default_rng(31), 300, 4)
    expected = native_core.run_control(params, raw, setpoint)
    for name in names_of("quad"):
        actual = Words(expected.record.copy())
        actual.record[name][217, 2] ^= 1
        found = first_divergence(expected, actual)
        assert found is not None and (found.step, found.run, found.signal) == (217, 2, name)
        assert found.expected is not None and found.actual is not None and found.expected ^ found.actual == 1
        assert found.as_dict()["signal"] == name and count_mismatches(expected, actual) == 1


def test_a_record_that_ends_early_diverges_there() -> None:
    params, (raw, setpoint) = quantise(quad.TUNINGS["paper"]), wild_inputs(np.random.default_rng(32), 50, 1)
    words = run_fixed.run_control(params, raw[:, :, 0], setpoint[:, 0])
    short = Words(words.record[:40])
    found = first_divergence(words, short)
    assert found is not None and (found.step, found.signal) == (40, "steps")
    assert first_digest_divergence(words.digests(), short.digests()) == 40
    flipped = words.digests() ^ (np.arange(50) == 13).astype(np.uint32)
    assert first_digest_divergence(words.digests(), flipped) == 13
    assert first_digest_divergence(words.digests(), words.digests()) is None
