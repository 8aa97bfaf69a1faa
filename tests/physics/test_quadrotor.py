"""The quadrotor, its wind, its ground and its sensors against closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from plumb.physics.airframe import (
    AIR_KGPM3,
    AIRFRAMES,
    G_MPS2,
    HUMMINGBIRD,
    IRIS,
    Airframe,
    command_for,
    thrust_share,
)
from plumb.physics.ground import Ground
from plumb.physics.imu import DRAWS, IMU_GRADES, MPU6050, Imu
from plumb.physics.quadrotor import Quadrotor, matrix_of
from plumb.physics.vectors import to_body, to_earth
from plumb.physics.wind import Wind, lengths_m, sigmas_mps
from plumb.spec.arrays import FloatArray

STEP_S = 0.00125
VACUUM = replace(HUMMINGBIRD, drag_area_m2=0.0, rotor_drag_kg=0.0, rolling_moment_kgm=0.0)


def level(frame: Airframe, runs: int = 2) -> Quadrotor:
    attitude = np.zeros((4, runs))
    attitude[0] = 1.0
    return Quadrotor(frame, attitude, np.zeros((3, runs)), vibration_g=0.0)


def flown(body: Quadrotor, seconds: float, target_radps: FloatArray | None = None) -> FloatArray:
    """Advance in still air; the last specific force."""
    felt = np.zeros_like(body.position_m)
    for _ in range(round(seconds / STEP_S)):
        felt = body.advance(body.rotor_radps.copy() if target_radps is None else target_radps, 0.0, STEP_S)
    return felt


@pytest.mark.parametrize("frame", AIRFRAMES.values())
def test_a_hover_stays_and_feels_one_g(frame: Airframe) -> None:
    body = level(frame)
    body.spin_up(frame.hover_radps)
    command = np.full((4, 2), command_for(np.array(frame.weight_n / frame.thrust_max_n)))
    felt = flown(body, 2.0, body.target_radps(command))
    # The rotors of the iris are not placed evenly: it pitches a little.
    assert np.max(np.abs(body.position_m[:, 0])) < (1e-6 if frame is HUMMINGBIRD else 1.0)
    assert np.linalg.norm(felt[:, 0]) == pytest.approx(G_MPS2, rel=1e-9 if frame is HUMMINGBIRD else 1e-2)


def test_the_drag_of_the_airframes_is_that_of_the_sources() -> None:
    assert HUMMINGBIRD.drag_per_s == pytest.approx(0.204, abs=5e-4) and HUMMINGBIRD.mass_kg == pytest.approx(0.716)
    assert IRIS.drag_per_s == pytest.approx(0.366, abs=5e-4) and IRIS.mass_kg == pytest.approx(1.535)


def test_a_fall_feels_nothing_and_ends_at_its_terminal_speed() -> None:
    body = level(VACUUM)
    felt = flown(body, 1.0)
    # Steps of the first order: a fall of 1 s is wrong by STEP_S / 1 s of itself.
    assert body.position_m[2] == pytest.approx([-G_MPS2 / 2.0] * 2, rel=2e-3) and not felt.any()
    dragged = level(replace(VACUUM, drag_area_m2=0.012))
    felt = flown(dragged, 60.0)
    terminal = np.sqrt(2.0 * VACUUM.weight_n / (AIR_KGPM3 * 0.012))
    # 60 s are more than ten times the terminal speed over g.
    assert dragged.velocity_mps[2] == pytest.approx([-terminal] * 2, rel=1e-3)
    assert felt[2] == pytest.approx([G_MPS2] * 2, rel=1e-3)


def test_a_slow_speed_decays_with_the_rotor_drag() -> None:
    body = level(replace(VACUUM, rotor_drag_kg=HUMMINGBIRD.rotor_drag_kg))
    body.spin_up(HUMMINGBIRD.hover_radps)
    body.velocity_mps[0] = 3.0
    felt = flown(body, 2.0)
    left = 3.0 * np.exp(-2.0 * HUMMINGBIRD.drag_per_s)
    # Steps of the first order: a decay by d over t is wrong by d^2 t STEP_S / 2, less than 1e-4.
    assert body.velocity_mps[0] == pytest.approx([left] * 2, rel=1e-3)
    assert felt[0] == pytest.approx([-HUMMINGBIRD.drag_per_s * left] * 2, rel=1e-3)


def test_a_thrown_body_keeps_its_energy_and_its_angular_momentum() -> None:
    body = level(VACUUM)
    body.velocity_mps[:] = np.array([[2.0], [0.0], [5.0]])
    body.rate_radps[:] = np.array([[3.0], [2.0], [-4.0]])
    inertia = np.array(VACUUM.inertia_kgm2)[:, None]

    def energy() -> FloatArray:
        moving = VACUUM.mass_kg * (body.velocity_mps**2).sum(axis=0) / 2.0
        turning = (inertia * body.rate_radps**2).sum(axis=0) / 2.0
        return np.asarray(moving + turning + VACUUM.weight_n * body.position_m[2])

    begun, momentum = energy(), to_earth(body.matrix, inertia * body.rate_radps)
    flown(body, 2.0)
    # Steps of the first order lose 0.8 % of the energy in 2 s at these rates, and half of it with half of STEP_S.
    assert energy() == pytest.approx(begun, rel=0.01)
    assert to_earth(body.matrix, inertia * body.rate_radps) == pytest.approx(momentum, rel=0.02, abs=1e-4)


def test_rotors_turn_the_body_the_way_they_push() -> None:
    for rotor, axis, sign in ((1, 0, 1.0), (2, 1, 1.0), (0, 2, 1.0), (1, 2, -1.0)):  # left, back; front cw, left ccw
        body = level(VACUUM)
        body.spin_up(VACUUM.hover_radps)
        target = body.rotor_radps.copy()
        target[rotor] *= 1.05
        flown(body, 0.02, target)
        assert np.sign(body.rate_radps[axis, 0]) == sign, rotor


def test_rotors_lag_and_the_thrust_curve_has_an_inverse() -> None:
    body = level(VACUUM)
    body.spin_up(400.0)
    flown(body, 0.0125, np.full((4, 2), 500.0))
    assert body.rotor_radps == pytest.approx(np.full((4, 2), 500.0 - 100.0 * np.exp(-1.0)), rel=1e-6)
    flown(body, 0.025, np.full((4, 2), 400.0))
    assert body.rotor_radps[0, 0] == pytest.approx(400.0 + 100.0 * (1.0 - np.exp(-1.0)) * np.exp(-1.0), rel=1e-6)
    shares = np.linspace(0.0, 1.0, 11)
    assert thrust_share(command_for(shares)) == pytest.approx(shares)


def test_matrices_turn_to_earth_and_back() -> None:
    rng = np.random.default_rng(1)
    q = rng.standard_normal((4, 5))
    matrix, vectors = matrix_of(q / np.linalg.norm(q, axis=0)), rng.standard_normal((3, 5))
    assert to_body(matrix, to_earth(matrix, vectors)) == pytest.approx(vectors)
    quarter = np.array([[np.cos(np.pi / 4)], [0.0], [0.0], [np.sin(np.pi / 4)]])
    assert to_earth(matrix_of(quarter), np.array([[1.0], [0.0], [0.0]])).ravel() == pytest.approx([0.0, 1.0, 0.0])


def test_vibration_has_the_speed_of_the_rotors_and_no_mean() -> None:
    attitude = np.array([[1.0], [0.0], [0.0], [0.0]])
    body = Quadrotor(VACUUM, attitude, np.zeros((3, 1)), vibration_g=0.3)
    body.spin_up(VACUUM.hover_radps)
    felt = np.array([body.advance(body.rotor_radps.copy(), 0.0, STEP_S)[:, 0] for _ in range(8000)])
    # The last turn is not whole: 8 m/s^2 over 2 pi 72 Hz and 10 s are 0.002.
    assert np.abs(felt[:, :2].mean(axis=0)) == pytest.approx([0.0, 0.0], abs=0.01)
    shown = np.sinc(VACUUM.hover_radps / (2.0 * np.pi) * STEP_S)  # the mean over a step
    assert felt[:, 0].std() == pytest.approx(4.0 * 0.3 * G_MPS2 / np.sqrt(2.0) * shown, rel=1e-3)  # four in phase
    spectrum = np.abs(np.fft.rfft(felt[:, 0]))
    hz = np.fft.rfftfreq(len(felt), STEP_S)[np.argmax(spectrum)]
    # Two lines of a spectrum of 10 s.
    assert hz == pytest.approx(VACUUM.hover_radps / (2.0 * np.pi), abs=0.2)


def test_gusts_have_the_size_and_the_length_of_dryden() -> None:
    runs, step_s = 4000, 0.05
    rng = np.random.default_rng(2)
    wind = Wind(5.0, np.zeros(runs), rng.standard_normal((5, runs)))
    horizontal, vertical = sigmas_mps(10.0, 5.0)
    # The digits of the source's tables.
    assert (horizontal, vertical) == pytest.approx((0.943, 0.5), abs=2e-3)
    assert lengths_m(10.0) == pytest.approx((67.4, 10.0), rel=0.01)
    begun = wind.velocity_mps()
    for _ in range(100):
        wind.advance(rng.standard_normal((3, runs)), step_s)
    found = wind.velocity_mps()
    for gusts in (begun, found):
        # Four standard errors of 4000 runs: 0.94 / sqrt(4000) of a mean, 1 / sqrt(8000) of a spread.
        assert gusts.mean(axis=1) == pytest.approx([5.0, 0.0, 0.0], abs=0.06)
        assert gusts.std(axis=1) == pytest.approx([horizontal, horizontal, vertical], rel=0.05)
    kept = float(np.corrcoef(begun[0], found[0])[0, 1])
    # A correlation of 4000 runs is known to 1 / sqrt(4000) = 0.016: three standard errors.
    assert kept == pytest.approx(np.exp(-5.0 * 5.0 / lengths_m(10.0)[0]), abs=0.05)
    still = Wind(5.0, np.full(2, np.pi / 2.0), np.ones((5, 2)), gusts=False)
    still.advance(np.ones((3, 2)), step_s)
    assert still.velocity_mps()[:, 0] == pytest.approx([0.0, 5.0, 0.0])


@pytest.mark.parametrize("slope_deg", [0.0, 10.0])
def test_a_body_stands_on_its_legs_and_does_not_slide(slope_deg: float) -> None:
    slope = np.radians(slope_deg)
    ground = Ground(HUMMINGBIRD, slope)
    attitude = np.array([[np.cos(slope / 2.0)], [0.0], [-np.sin(slope / 2.0)], [0.0]])
    body = Quadrotor(HUMMINGBIRD, attitude, (ground.normal * 0.1)[:, None])
    felt = np.zeros((3, 1))
    for _ in range(round(2.0 / STEP_S)):
        felt = body.advance(np.zeros((4, 1)), 0.0, STEP_S, ground)
    sunk = HUMMINGBIRD.weight_n * np.cos(slope) / (4.0 * 600.0)
    # What is left of the bounce after 2 s: less than a tenth of the 3 mm by which the legs give, and 1 % of g.
    assert ground.normal @ body.position_m[:, 0] == pytest.approx(HUMMINGBIRD.leg_down_m - sunk, abs=2e-4)
    assert np.linalg.norm(body.velocity_mps) < 0.01 and ground.touched(body.position_m, 0.01).all()
    assert felt[:, 0] / G_MPS2 == pytest.approx([np.sin(slope), 0.0, np.cos(slope)], abs=0.01)
    # The accelerometer at rest shows the vertical.
    assert body.matrix[2, :, 0] == pytest.approx(felt[:, 0] / G_MPS2, abs=0.01)


@pytest.mark.parametrize("name", IMU_GRADES)
def test_sensors_have_the_errors_of_their_grade(name: str) -> None:
    grade, runs = IMU_GRADES[name], 2000
    rng = np.random.default_rng(3)
    imu = Imu(grade, rng.standard_normal((DRAWS, runs)), 0.0025)
    zero, quiet, turning = np.zeros((3, runs)), np.zeros((6, runs)), np.zeros((3, runs))
    turning[0] = 1000.0
    cold, warm = (imu.counts(time_s, zero, zero, quiet)[:, :3] * grade.gyro.unit_per_count for time_s in (0.0, 900.0))
    assert np.abs(cold) == pytest.approx(np.ones((runs, 3)), abs=grade.gyro.unit_per_count)
    # Of 6000 draws a spread is known to 1 / sqrt(12000) = 0.9 %, of 2000 to 1.6 %, a mean of 1 % to 2e-4: four
    # standard errors and more.
    assert np.std(warm - cold) == pytest.approx(0.5, rel=0.05)
    turned = (imu.counts(0.0, turning, zero, quiet)[:, :3] * grade.gyro.unit_per_count - cold) / 1000.0
    assert turned.mean(axis=0) == pytest.approx([1.0, 0.0, 0.0], abs=1e-3)
    assert turned.std(axis=0) == pytest.approx([0.01, 0.007, 0.007], rel=0.06)
    noisy = imu.counts(0.0, zero, zero, rng.standard_normal((6, runs))) - imu.counts(0.0, zero, zero, quiet)
    # Rounding is not independent of a noise below a count: the sum of squares holds to a tenth.
    assert np.std(noisy[:, :3] * grade.gyro.unit_per_count) == pytest.approx(
        np.hypot(grade.gyro_noise_dps * np.sqrt(200.0), grade.gyro.unit_per_count / np.sqrt(6.0)), rel=0.1
    )
    assert imu.counts(0.0, turning * 9.0, zero + 99.0, quiet)[0, [0, 3]].tolist() == [
        grade.gyro.max_counts, grade.accel.max_counts,
    ]  # fmt: skip


def test_an_offset_of_the_accelerometer_is_that_of_the_grade() -> None:
    drawn = np.zeros((DRAWS, 1))
    drawn[12:15, 0] = [1.0, -1.0, 0.0]
    counts = Imu(MPU6050, drawn, 0.0025).counts(0.0, np.zeros((3, 1)), np.zeros((3, 1)), np.zeros((6, 1)))
    assert counts[0, 3:].tolist() == [4, -4, 0]  # 2 mg at 2048 counts per g
