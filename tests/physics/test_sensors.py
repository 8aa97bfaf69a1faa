"""The analog sensors: data-sheet volts, the low-pass in closed form, the ADC's rounding, and each fault."""

from __future__ import annotations

import math

import numpy as np
import pytest

from plumb.errors import UsageError
from plumb.physics.sensors import ADC_REFERENCE_V, Enc03, Fault, Mma7260, OnePole, adc_counts
from plumb.systems.quad import scenarios as quad
from plumb.systems.quad.lateral import GRID_S
from plumb.systems.quad.plant import QuadPlant


@pytest.mark.parametrize(
    ("volts", "counts"),
    [(0.0, 0), (-0.1, 0), (1.65, 2048), (3.3, 4095), (5.0, 4095), (0.6 * 3.3 / 4096, 1), (0.4 * 3.3 / 4096, 0)],
)
def test_the_adc_rounds_to_the_nearest_count_and_clips(volts: float, counts: int) -> None:
    assert adc_counts(volts) == counts


@pytest.mark.parametrize(
    ("rate_dps", "volts"), [(0.0, 1.35), (100.0, 1.417), (-100.0, 1.283), (300.0, 1.551), (900.0, 1.551)]
)
def test_the_gyro_has_its_data_sheet_scale_and_stops_at_its_range(rate_dps: float, volts: float) -> None:
    assert Enc03().volts(np.array([rate_dps]))[0] == pytest.approx(volts, abs=1e-12)


@pytest.mark.parametrize(
    ("accel_g", "volts"), [(0.0, 1.65), (1.0, 2.45), (-1.0, 0.85), (1.5, 2.85), (9.0, 2.85), (-9.0, 0.45)]
)
def test_the_accelerometer_has_its_data_sheet_scale_and_stops_at_its_range(accel_g: float, volts: float) -> None:
    assert Mma7260().volts(np.array([accel_g]))[0] == pytest.approx(volts, abs=1e-12)


def test_the_noise_rule_of_the_paper_gives_the_stated_noise() -> None:
    # 350 ug * sqrt(1.5 * bandwidth), with pi/2 where the paper rounds to 1.5; 8.2 mg is stated for 350 Hz.
    assert Mma7260(350.0).noise_g == pytest.approx(8.2e-3, abs=0.05e-3)
    assert Mma7260(5.0).noise_g == pytest.approx(350e-6 * math.sqrt(1.5 * 5.0), rel=0.03)


@pytest.mark.parametrize("sensor", [Enc03(), Mma7260()])
def test_calibration_undoes_the_sensor_to_half_a_count(sensor: Enc03 | Mma7260) -> None:
    full = sensor.range_dps if isinstance(sensor, Enc03) else sensor.range_g
    channel = sensor.channel()
    truth = np.linspace(-full, full, 1001)
    counts = adc_counts(sensor.volts(truth)).astype(float)
    assert np.max(np.abs((counts - channel.zero_counts) * channel.unit_per_count - truth)) <= (
        0.5000001 * channel.unit_per_count
    )
    assert channel.min_counts < counts.min() and counts.max() < channel.max_counts


@pytest.mark.parametrize("bandwidth_hz", [0.5, 5.0, 350.0])
def test_the_low_pass_follows_a_ramp_with_the_lag_of_one_pole(bandwidth_hz: float) -> None:
    step_s = 1e-3
    time_s = np.asarray(np.arange(2000) * step_s, np.float64)
    lag_s = 1.0 / (2.0 * math.pi * bandwidth_hz)
    expected = time_s - lag_s * (1.0 - np.exp(-time_s / lag_s))
    assert np.max(np.abs(OnePole.of(bandwidth_hz, step_s).run(time_s) - expected)) < 1e-12


def test_the_low_pass_starts_settled_and_refuses_no_bandwidth() -> None:
    assert np.max(np.abs(OnePole.of(5.0, 1e-3).run(np.full(500, 0.7)) - 0.7)) < 1e-13
    with pytest.raises(UsageError, match="above 0"):
        OnePole.of(0.0, 1e-3)


def test_less_bandwidth_means_less_noise_more_lag() -> None:
    # The paper's trade: the noise falls with the bandwidth while the motion starts to lag.
    noise_g, lag_deg = [], []
    for bandwidth_hz in quad.BANDWIDTHS_HZ:
        run = quad.scenario("quiet", 1000, bandwidth_hz=bandwidth_hz, seconds=30.0)
        noise_g.append(float(np.std(run.accel_noise_g)))
        y_g = OnePole.of(bandwidth_hz, GRID_S).run(np.sin(np.radians(run.prescribed_deg)))
        lag_deg.append(float(np.max(np.abs(np.degrees(np.arcsin(y_g)) - run.prescribed_deg))))
    assert noise_g == sorted(noise_g) and lag_deg == sorted(lag_deg, reverse=True)
    # One pole of 5 Hz lags by 32 ms, one of 350 Hz by 0.45 ms: these hold for any motion of 31 to 220 deg/s at most.
    assert lag_deg[0] > 1.0 > 0.1 > lag_deg[-1]
    assert noise_g[0] / noise_g[-1] == pytest.approx(math.sqrt(5.0 / 350.0), rel=0.1)


@pytest.mark.parametrize("kind", ["railed", "stuck", "noisy", "silent"])
@pytest.mark.parametrize("channel", [0, 1, 2])
def test_a_fault_shows_on_its_channel_in_its_time_alone(kind: str, channel: int) -> None:
    good = quad.scenario("motion", 5, seconds=20.0).counts()
    fault = Fault(kind, channel, 8.0, 12.0)  # type: ignore[arg-type]
    run = quad.scenario("motion", 5, seconds=20.0, faults=(fault,))
    bad = run.counts()
    inside = (run.time_s >= 8.0) & (run.time_s < 12.0)
    others = [c for c in range(3) if c != channel]
    assert np.array_equal(good[~inside], bad[~inside]) and np.array_equal(good[:, others], bad[:, others])
    seen = bad[inside, channel]
    if kind == "noisy":
        # The fault adds 100 mV rms; 200 samples measure it to 5 %: four standard errors.
        assert 80 < np.std(seen - good[inside, channel].astype(float)) / (4096 / ADC_REFERENCE_V) * 1000 < 120
    else:
        assert set(seen.tolist()) == {{"railed": 4095, "silent": 0, "stuck": int(good[inside][0, channel])}[kind]}


def test_the_plant_shows_the_same_faults_as_the_prescribed_counts() -> None:
    faults = (Fault("stuck", 0, 2.0, 4.0), Fault("noisy", 1, 3.0), Fault("railed", 2, 5.0, 6.0))
    run = quad.scenario("motion", 6, seconds=10.0, faults=faults)
    plant, counts = QuadPlant(run, open_loop=True), run.counts()
    for k, time_s in enumerate(run.time_s):
        plant.advance_to(time_s, (1500.0, 1500.0))
        assert plant.counts(time_s) == tuple(counts[k].tolist())


def test_an_unknown_fault_is_refused() -> None:
    with pytest.raises(UsageError, match="railed, stuck, noisy or silent"):
        quad.scenario("motion", 1, seconds=10.0, faults=(Fault("melted", 0, 1.0),)).counts()  # type: ignore[arg-type]
