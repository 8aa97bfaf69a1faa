"""The step of `quadrotor` in float64 against the one in integers: they differ by rounding alone."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import numpy.typing as npt
import pytest

from plumb.contract import run_fixed
from plumb.contract.parameters import dequantise, quantise
from plumb.spec.arrays import FloatArray
from plumb.spec.records import Words
from plumb.spec.tuning import Channel
from plumb.systems.attitude import reference as attitude_reference
from plumb.systems.attitude.settings import Aid, Motion
from plumb.systems.attitude.tuning import AttitudeTuning
from plumb.systems.quadrotor import fixed_mixer, reference
from plumb.systems.quadrotor.reference_rates import error_of_vertical
from plumb.systems.quadrotor.settings import RateGains, Rates, Receiver
from plumb.systems.quadrotor.tuning import QuadrotorTuning

PERIOD_US, STEPS = 2500, 2400
GYRO, ACCEL = (Channel(0.0, by, -32767, 32767) for by in (2000.0 / 32768.0, 1.0 / 2048.0))
ALL_TERMS = RateGains(kp_per_dps=0.001, ki_per_deg=0.0015, kd_per_dps2=2e-5, ff_per_dps=1e-4)
TUNING = QuadrotorTuning(
    period_us=PERIOD_US,
    attitude=AttitudeTuning(
        PERIOD_US, GYRO, ACCEL, aid=Aid(drag_per_s=0.3, hover=0.25), motion=Motion(unsure_deg=20.0)
    ),
    rates=Rates(roll=ALL_TERMS, pitch=ALL_TERMS, yaw=RateGains(kp_per_dps=0.004, ki_per_deg=0.006)),
    receiver=Receiver(lands=1, held_s=0.2, back_s=0.1, land_s=0.6),
)
ON, TAKE_OFF, LOST, BACK, LOST_AGAIN, OFF = 450, 500, 1000, 1160, 1800, 2350
PHASES = ((0, 0), (1040, 1), (1121, 2), (1199, 0), (1840, 1), (1921, 2), (2162, 3), (OFF, 0))
"""Steps in which the phase changes: 40 steps after the last frame, and so on."""


def flight() -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Shaken on the ground and in the air, with gaps, in both modes, without its receiver twice."""
    rng, step = np.random.default_rng(3), np.arange(STEPS)
    time_s = PERIOD_US * 1e-6 * step
    raw = np.zeros((STEPS, 12), np.int64)
    raw[:, :3] = 300.0 * np.sin(time_s)[:, None] * rng.normal(size=(STEPS, 3))
    raw[:, 3:6] = np.array([0.0, 0.0, 2048.0]) + rng.normal(0.0, 50.0, (STEPS, 3))
    raw[rng.random(STEPS) < 0.05, 0] = -32768
    raw[:, 6:9] = 32767.0 * np.sin(np.outer(time_s, [1.0, 1.7, 2.3]))
    raw[:, 9] = np.where((step >= ON) & (step < OFF), 1, 0) + 2 * ((step > 700) & (step < 900))
    frames = step // 4 % 255 + 1
    raw[:, 10] = frames
    raw[LOST:BACK, 10], raw[LOST_AGAIN:, 10] = frames[LOST], frames[LOST_AGAIN]
    return raw, np.where(step > TAKE_OFF, 16000.0 + 8000.0 * np.sin(time_s), 500.0).astype(np.int64)


@lru_cache(maxsize=1)
def both() -> tuple[Words, dict[str, FloatArray]]:
    params = quantise(TUNING)
    raw, throttle = flight()
    return run_fixed.run_control(params, raw, throttle), reference.run_control(dequantise(params), raw, throttle)  # type: ignore[arg-type]


def test_the_flight_goes_through_every_phase() -> None:
    phase = both()[0]["phase"]
    changes = np.flatnonzero(np.diff(phase, prepend=-1))
    assert [(int(step), int(phase[step])) for step in changes] == list(PHASES)


@pytest.mark.parametrize(("word", "unit", "names", "bound"), [
    ("up_q30", 2.0**-30, "up_{}", 1e-5),
    ("rate_turnps_q28", 360.0 * 2.0**-28, "rate_{}_dps", 2e-4),
    ("asked_turnps_q28", 360.0 * 2.0**-28, "asked_{}_dps", 0.0035),  # the vertical's by the gain, 344 deg/s
])  # fmt: skip
def test_vertical_and_rates_are_those_of_float64(word: str, unit: float, names: str, bound: float) -> None:
    fixed, floats = both()
    for number, axis in enumerate("xyz"):
        assert np.abs(unit * fixed[f"{word}_{number}"] - floats[names.format(axis)]).max() < bound


def test_vertical_is_that_of_attitude_with_the_throttle_of_the_step_before() -> None:
    (raw, throttle), period_s = flight(), PERIOD_US * 1e-6
    floats = reference.run_control(replace(TUNING, exact_period_s=period_s), raw, throttle)
    alone = attitude_reference.run_control(TUNING.attitude, raw[:, :6], floats["collective"] * 2.0**15)
    for axis in "xyz":
        assert np.abs(alone[f"up_{axis}"] - floats[f"up_{axis}"]).max() < 1e-12


def test_error_of_the_vertical_is_that_of_float64_in_any_attitude() -> None:
    """The inverse of one plus the cosine is a multiple of 2^-14, and its divisor of 2^-18, at least 2^-6."""
    rng, words = np.random.default_rng(8), quantise(TUNING).values
    up = rng.normal(size=(4000, 3))
    up /= np.linalg.norm(up, axis=1)[:, None]
    sticks = rng.choice([-32767, 0, 9000, 32767], (4000, 2))
    up_q30 = np.rint(up * 2.0**30).astype(np.int64)
    demands = ((roll, pitch, 0) for roll, pitch in sticks.tolist())
    found = np.array([
        fixed_mixer.ask(words, one, stick, True, 0)[0] for one, stick in zip(up_q30.tolist(), demands, strict=True)
    ])  # fmt: skip
    sine = words["quadrotor.tilt_max_q30"] / 2.0**30
    leans = (sticks / 2.0**15 * sine).tolist()
    wanted = np.array([error_of_vertical((x, y), one) for (x, y), one in zip(leans, up, strict=True)])
    off = np.abs(found / 2.0**28 - wanted).max(axis=1)
    assert off.max() < 2.0 * (2.0**-12 + 2.0**-14)
    assert off[np.linalg.norm(wanted, axis=1) < 0.9].max() < 2.0**-25, "a sine: nothing is divided"
    assert (np.abs(wanted[:, 1]) == 2.0).any()


def test_rotors_are_those_of_float64() -> None:
    """The mixer scales roll and pitch by steps of 2^-15; the thrust of a hover, which a lost receiver brings into play,
    has a cube root within 0.5 %."""
    fixed, floats = both()
    bound = np.where(fixed["phase"] == 0, 2e-4, 0.005)
    for number in range(4):
        assert (np.abs(fixed[f"rotor_q24_{number}"] / 2.0**24 - floats[f"rotor_{number}"]) < bound).all()
    assert (np.abs(fixed["thrust_q24"] / 2.0**24 - floats["thrust"]) < bound).all()


def test_commands_that_are_not_given_have_their_defaults() -> None:
    raw, throttle = flight()
    found = reference.run_control(TUNING, raw[:200, :6], throttle[:200])
    assert set(found["rotor_0"]) == {0.0}, "the rotors are off"
    batch = reference.run_control(TUNING, np.stack([raw[:200]] * 2, axis=-1), np.stack([throttle[:200]] * 2, axis=-1))
    assert batch["rotor_0"].shape == (200, 2)
    assert np.array_equal(batch["rotor_0"][:, 1], reference.run_control(TUNING, raw[:200], throttle[:200])["rotor_0"])
