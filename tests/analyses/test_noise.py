"""Noise of a rest: published Allan variances, figures recovered within their stated confidence, and the rest found."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from plumb.analyses.identification import allan, chosen_settings, noise, noise_fit, rest
from plumb.errors import UsageError
from plumb.spec.arrays import FloatArray

pytest.importorskip("scipy", reason="scipy is not installed: the extra tune")

PERIOD_S = 0.01
WHITE, FLICKER, WALK = 0.05, 0.03, 0.012


def white(rng: np.random.Generator, samples: int, density: float) -> FloatArray:
    return density / math.sqrt(PERIOD_S) * rng.standard_normal(samples)


def walk(rng: np.random.Generator, samples: int, density: float) -> FloatArray:
    return density * math.sqrt(PERIOD_S) * np.cumsum(rng.standard_normal(samples))


def flicker(rng: np.random.Generator, samples: int, instability: float) -> FloatArray:
    """White noise through the half integrator (1 - z^-1)^(-1/2), whose density is B^2 / (2 pi f) far below the rate."""
    k = np.arange(1, samples)
    response = np.concatenate([[1.0], np.cumprod((k - 0.5) / k)])
    length = 2 * samples
    drive = instability * rng.standard_normal(samples)
    return np.asarray(np.fft.irfft(np.fft.rfft(response, length) * np.fft.rfft(drive, length), length)[:samples])


def test_allan_deviation_of_the_published_test_set() -> None:
    """NIST SP 1065, 5.15: 1000 values of a congruential generator, and their overlapping Allan deviation."""
    numbers, values = 1234567890, []
    for _ in range(1000):
        values.append(numbers / 2147483647.0)
        numbers = 16807 * numbers % 2147483647
    found = np.sqrt(allan.variances(np.array(values), [1, 10, 100]))
    assert found == pytest.approx([2.922319e-1, 9.159953e-2, 3.241343e-2], rel=1e-6)


def test_interval_of_the_allan_deviation_holds_the_truth_as_often_as_it_says() -> None:
    """95 % of the intervals of white noise hold its deviation, at a short and at the longest averaging time."""
    held = []
    for seed in range(120):
        found = allan.allan_deviation(white(np.random.default_rng(seed), 600, WHITE), PERIOD_S, lambda _: "white")
        truth = WHITE / np.sqrt(found.tau_s)
        held.append(((found.low <= truth) & (truth <= found.high))[[0, 10, -1]])
    assert np.all(np.mean(held, axis=0) >= 0.88) and np.all(np.mean(held, axis=0) <= 1.0)


def test_known_noises_are_recovered_within_their_confidence() -> None:
    """Of 95 % intervals, fewer than 17 of 20 holding the truth has a chance below 2 %."""
    held, values = [], []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        signal = 3.0 + white(rng, 20_000, WHITE) + flicker(rng, 20_000, FLICKER) + walk(rng, 20_000, WALK)
        model = noise_fit.fit(noise_fit.Spectrum(signal, PERIOD_S))
        parts = list(zip((model.white, model.flicker, model.walk), (WHITE, FLICKER, WALK), strict=True))
        held.append([part.low <= truth <= part.high for part, truth in parts])
        values.append([part.value for part, _ in parts])
    assert np.all(np.sum(held, axis=0) >= 17), np.sum(held, axis=0)
    # The mean of 20 records: the walk of a single one is known to a factor of some 1.5.
    assert np.mean(values, axis=0) == pytest.approx([WHITE, FLICKER, WALK], rel=0.35)


def test_intervals_are_narrow_where_the_record_is_long() -> None:
    rng = np.random.default_rng(7)
    model = noise_fit.fit(noise_fit.Spectrum(white(rng, 100_000, WHITE) + walk(rng, 100_000, 0.02), PERIOD_S))
    assert model.white.high / model.white.low < 1.06
    assert model.walk.low > 0.0 and model.walk.high / model.walk.low < 2.5


def test_noise_that_is_not_there_is_not_claimed() -> None:
    model = noise_fit.fit(noise_fit.Spectrum(white(np.random.default_rng(3), 30_000, WHITE), PERIOD_S))
    assert model.flicker.low == 0.0 and model.walk.low == 0.0
    assert 0.0 < model.walk.high < 0.01 and 0.0 < model.flicker.high < 0.02


def test_a_line_in_the_spectrum_is_reported() -> None:
    rng = np.random.default_rng(5)
    signal = white(rng, 20_000, WHITE)
    clean = noise_fit.Spectrum(signal, PERIOD_S)
    assert noise_fit.misfit(clean, noise_fit.fit(clean)) is None
    signal += 0.6 * np.sin(2.0 * np.pi * 5.0 * PERIOD_S * np.arange(20_000))
    shaken = noise_fit.Spectrum(signal, PERIOD_S)
    assert noise_fit.misfit(shaken, noise_fit.fit(shaken)) is not None
    quiet = noise_fit.Spectrum(signal, PERIOD_S, highest_hz=3.0)
    assert noise_fit.misfit(quiet, noise_fit.fit(quiet)) is None


@pytest.mark.parametrize(
    ("signal", "sentence"), [(np.zeros(1000), "does not change"), (np.ones(100), "too few to measure noise")]
)
def test_signal_without_noise_is_refused(signal: FloatArray, sentence: str) -> None:
    with pytest.raises(UsageError, match=sentence):
        noise_fit.Spectrum(signal, PERIOD_S)


def recorded(folder: Path, moving: tuple[float, float] | None, seconds: float = 40.0) -> Path:
    """A three-axis recording with white noise, which turns between the two times."""
    rng = np.random.default_rng(11)
    samples = round(seconds / PERIOD_S)
    time_s = PERIOD_S * np.arange(samples)
    gyr_dps = np.column_stack([white(rng, samples, WHITE * (1 + axis)) for axis in range(3)]) + np.array(
        [2.0, -1.0, 0.5]
    )
    acc_g = np.column_stack([white(rng, samples, 3e-4) for _ in range(3)]) + np.array([0.0, 0.0, 1.0])
    if moving is not None:
        turn = (time_s >= moving[0]) & (time_s < moving[1])
        gyr_dps[turn] += 60.0 * np.sin(2.0 * np.pi * 0.5 * time_s[turn])[:, None]
    path = folder / "rest.npz"
    np.savez(path, gyr=np.radians(gyr_dps), acc=9.80665 * acc_g, rate_hz=1.0 / PERIOD_S)
    return path


def test_longest_rest_is_found(tmp_path: Path) -> None:
    found = rest.longest_rest(rest.load(recorded(tmp_path, (25.0, 30.0))))
    assert 0.0 <= found.first_s <= 1.0 and 22.9 <= found.last_s <= 25.0
    whole = rest.longest_rest(rest.load(recorded(tmp_path, None)))
    assert (whole.first_s, whole.last_s) == pytest.approx((0.0, 40.0))


def test_a_recording_that_never_rests_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no rest of 10 s"):
        rest.longest_rest(rest.load(recorded(tmp_path, (0.0, 40.0))))


def test_a_slow_turn_is_no_rest(tmp_path: Path) -> None:
    path = recorded(tmp_path, None)
    with np.load(path) as file:
        columns = dict(file)
    columns["gyr"][2500:, 1] += np.radians(45.0)
    np.savez(path, **columns)
    assert rest.longest_rest(rest.load(path)).last_s <= 25.0


def test_q_and_r_follow_from_the_densities(tmp_path: Path) -> None:
    """Q_angle is the square of the gyro's density about the axis, R that of the tilt's in one sample of the system."""
    found = noise.measure(rest.longest_rest(rest.load(recorded(tmp_path, None))))
    for axis, gyro in (("x", WHITE), ("z", 3.0 * WHITE)):
        made = noise.filter_noise(found, "quad", None, 10_000, axis)
        assert made.values["kalman.q_angle_deg2_per_s"] == pytest.approx(gyro**2, rel=0.15)
        assert made.values["trust.r_deg2"] == pytest.approx(math.degrees(3e-4) ** 2 / 0.01, rel=0.2)
        assert not made.refusal
        assert dict(chosen_settings.numbers(made.tuning)).items() >= made.values.items()
    slower = noise.filter_noise(found, "quad", None, 20_000, "x")
    faster = noise.filter_noise(found, "quad", None, 10_000, "x")
    assert slower.values["trust.r_deg2"] == pytest.approx(faster.values["trust.r_deg2"] / 2.0, rel=1e-3)


def test_a_bias_whose_walk_is_not_seen_gets_the_most_it_can_be(tmp_path: Path) -> None:
    found = noise.measure(rest.longest_rest(rest.load(recorded(tmp_path, None))))
    made = noise.filter_noise(found, "quad", None, None, "x")
    gyro = next(one for one in found if one.channel.name == "gyr_x")
    assert gyro.as_filter.walk.low == 0.0
    assert made.values["kalman.q_bias_dps2_per_s"] == pytest.approx(gyro.as_filter.walk.high**2, rel=1e-4)
    assert "too short to show it" in made.notes["q_bias_dps2_per_s"]
