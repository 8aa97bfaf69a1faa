"""A drawn run of `balancer` as the numbers and signals of plant.c."""

from __future__ import annotations

import math

import numpy as np

from plumb.physics.sensors import FAULT_NOISE_LSB, FAULT_RAIL_LSB
from plumb.systems.balancer import vehicle
from plumb.systems.balancer.drawn_run import ACCELEROMETER, DPS_PER_G, GYRO, Scenario
from plumb.systems.compiled_plants import DrawnRun

PRESCRIBES = True


def drawn(scenario: Scenario, *, open_loop: bool) -> DrawnRun:
    moment_kgm = vehicle.BODY_KG * vehicle.BODY_CENTRE_M
    numbers = {
        "open_loop": float(open_loop),
        "grid_s": vehicle.GRID_S,
        "gravity_mps2": vehicle.GRAVITY_MPS2,
        "pendulum_m": vehicle.PENDULUM_M,
        "sensor_height_m": vehicle.SENSOR_HEIGHT_M,
        "wheel_radius_m": vehicle.WHEEL_RADIUS_M,
        "edge_m": vehicle.EDGE_M,
        "lie_rad": vehicle.LIE_RAD,
        "moment_kgm": moment_kgm,
        "inertia_kgm2": moment_kgm * vehicle.PENDULUM_M,
        "mass_kg": vehicle.WHEELS_KG + vehicle.WHEELS_KGM2 / vehicle.WHEEL_RADIUS_M**2 + vehicle.BODY_KG,
        "stall_nm": vehicle.STALL_NM,
        "no_load_radps": vehicle.NO_LOAD_RADPS,
        "friction_nm": vehicle.FRICTION_NM,
        "ideal_per_rad": vehicle.IDEAL_PER_RAD,
        "ideal_per_radps": vehicle.IDEAL_PER_RADPS,
        "ideal_per_mps": vehicle.IDEAL_PER_MPS,
        "ideal_limit_mps2": vehicle.IDEAL_LIMIT_MPS2,
        "push_radps2_per_mps2": vehicle.PUSH_RADPS2_PER_MPS2,
        "disturbance_keep": 1.0 - vehicle.GRID_S / vehicle.DISTURBANCE_TAU_S,
        "disturbance_new": vehicle.DISTURBANCE_RADPS2_PER_RTS * math.sqrt(vehicle.GRID_S),
        "scale": float(scenario.scale),
        "offset_x_g": float(scenario.offset_g[0]),
        "offset_z_g": float(scenario.offset_g[1]),
        "dps_per_g": DPS_PER_G,
        "gyro_lsb_per_dps": GYRO.lsb_per_dps,
        "accel_g_per_lsb": ACCELEROMETER.g_per_lsb,
        "accel_range_lsb": float(ACCELEROMETER.range_lsb),
        "fault_noise_lsb": FAULT_NOISE_LSB,
        "fault_rail_lsb": float(FAULT_RAIL_LSB),
    }
    signals = {
        "hand_rad": scenario.hand_rad,
        "held": scenario.held.astype(np.float64),
        "command_mps": scenario.command_mps,
        "push_mps2": scenario.push_mps2,
        "disturbance": scenario.disturbance,
        "bias_dps": scenario.bias_dps,
        "vibration_g": scenario.vibration_g,
        "accel_noise_lsb": scenario.accel_noise_lsb,
        "gyro_noise_dps": scenario.gyro_noise_dps,
        "fault_noise": scenario.fault_noise,
    }
    return DrawnRun(numbers, signals, scenario.faults, len(scenario.disturbance))
