"""A drawn run of `quad` as the numbers and signals of plant.c."""

from __future__ import annotations

import math

import numpy as np

from plumb.physics.sensors import ADC_COUNTS, ADC_REFERENCE_V, FAULT_NOISE_V, OnePole
from plumb.spec.arrays import FloatArray
from plumb.systems.compiled_plants import DrawnRun
from plumb.systems.quad import plant
from plumb.systems.quad.drawn_run import GYRO, Scenario
from plumb.systems.quad.lateral import GRID_S

PRESCRIBES = False


def drawn(scenario: Scenario, *, open_loop: bool) -> DrawnRun:
    pole = OnePole.of(scenario.accelerometer.bandwidth_hz, GRID_S)
    gust_keep = math.exp(-GRID_S / plant.GUST_TAU_S)
    accelerometer = scenario.accelerometer
    numbers = {
        "open_loop": float(open_loop),
        "grid_s": GRID_S,
        "delay_points": float(round(scenario.delay_s / GRID_S)),
        "motor_keep": math.exp(-GRID_S / plant.MOTOR_TAU_S),
        "thrust_moment_nm": plant.ARM_M * plant.THRUST_N,
        "friction_nms": plant.FRICTION_NMS,
        "inertia_kgm2": plant.INERTIA_KGM2,
        "imbalance_nm": plant.IMBALANCE_NM * float(scenario.torque_noise[0]),
        "gust_keep": gust_keep,
        "gust_new_nm": plant.GUST_NM * math.sqrt(1.0 - gust_keep * gust_keep),
        "stop_deg": plant.STOP_DEG,
        "pulse_zero_us": plant.PULSE_ZERO_US,
        "pulse_span_us": plant.PULSE_SPAN_US,
        "decay": pole.decay,
        "pole_new": pole.new,
        "pole_old": pole.old,
        "scale": float(scenario.scale),
        "offset_y_g": float(scenario.offset_g[0]),
        "offset_z_g": float(scenario.offset_g[1]),
        "gyro_zero_v": GYRO.zero_v,
        "gyro_v_per_dps": GYRO.v_per_dps,
        "gyro_range_dps": GYRO.range_dps,
        "accel_zero_v": accelerometer.zero_v,
        "accel_v_per_g": accelerometer.v_per_g,
        "accel_range_g": accelerometer.range_g,
        "adc_per_v": ADC_COUNTS / ADC_REFERENCE_V,
        "adc_most": ADC_COUNTS - 1.0,
        "reference_v": ADC_REFERENCE_V,
        "fault_noise_v": FAULT_NOISE_V,
    }
    signals = {
        "prescribed_deg": scenario.prescribed_deg,
        "lateral_g": scenario.lateral_g,
        "hand": scenario.hand.astype(np.float64),
        "gusts": scenario.torque_noise[1:],
        "pushed_nm": _pushed_nm(scenario),
        "bias_dps": scenario.bias_dps,
        "gyro_noise_dps": scenario.gyro_noise_dps,
        "accel_noise_g": scenario.accel_noise_g,
        "adc_noise_v": scenario.adc_noise_v,
        "fault_noise": scenario.fault_noise,
    }
    return DrawnRun(numbers, signals, scenario.faults, len(scenario.prescribed_deg))


def _pushed_nm(scenario: Scenario) -> FloatArray:
    """Torque of the pushes in the step that begins at each point of the grid."""
    points = len(scenario.prescribed_deg)
    pushed = np.zeros(points)
    for point in range(points) if scenario.pushes else ():
        time_s = point * GRID_S
        pushed[point] = sum(push.size for push in scenario.pushes if push.start_s <= time_s < push.stop_s)
    return pushed
