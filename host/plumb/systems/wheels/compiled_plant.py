"""A drawn run of `wheels` as the numbers and signals of plant.c."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from plumb.physics.sensors import FAULT_NOISE_LSB, FAULT_RAIL_LSB
from plumb.systems.balancer import vehicle as one_motor
from plumb.systems.compiled_plants import DrawnRun
from plumb.systems.wheels import plant, rides, vehicle
from plumb.systems.wheels.drawn_run import Scenario

PRESCRIBES = False


def drawn(scenario: Scenario, *, open_loop: bool) -> DrawnRun:
    """What the Python plant begins with is read from it. open_loop: not in C."""
    assert not open_loop
    begins = plant.WheelsPlant(scenario)
    happens = scenario.ride.happens()
    rows = [(rides.HAPPENINGS.index(one.what), *one[1:]) for one in happens]
    sensors = begins.imu
    fault = {"fault_noise_lsb": FAULT_NOISE_LSB, "fault_rail_lsb": float(FAULT_RAIL_LSB)}
    numbers = {**_ride(scenario, len(happens)), **_vehicle(scenario), **sensors.numbers(), **fault}
    signals = {
        "gyro_matrix": sensors.matrix,
        "gyro_bias_dps": sensors.bias_dps,
        "gyro_warm_up_dps": sensors.warm_up_dps,
        "accel_offset_g": sensors.offset_g,
        "happenings": np.array(rows, np.float64),
        "push_radps2": scenario.push_radps2,
        "asked_mps": scenario.asked_mps,
        "asked_dps": scenario.asked_dps,
        "white": scenario.white,
        "vibration_g": scenario.vibration_g,
        "fault_noise": scenario.fault_noise,
    }
    return DrawnRun(numbers, signals, scenario.faults, len(scenario.push_radps2))


def _ride(scenario: Scenario, happenings: int) -> Mapping[str, float]:
    return {
        "grid_s": vehicle.GRID_S,
        "period_us": float(scenario.period_us),
        "held_s": rides.HELD_S,
        "frame_s": plant.FRAME_S,
        "frame_numbers": float(plant.NUMBERS),
        "full": float(plant.FULL_Q15),
        "speed_max_mps": plant.SPEED_MAX_MPS,
        "turn_max_dps": plant.TURN_MAX_DPS,
        "by_receiver": float(scenario.ride.by_receiver),
        "happenings": float(happenings),
    }


def _vehicle(scenario: Scenario) -> Mapping[str, float]:
    ride = scenario.ride
    alone, ridden = (vehicle.load(ride.shift_m, ridden=with_rider) for with_rider in (False, True))
    return {
        "slope_rad": math.radians(ride.slope_deg),
        "supply": scenario.supply,
        "gravity_mps2": vehicle.G_MPS2,
        "radius_m": vehicle.RADIUS_M,
        "sensor_m": vehicle.SENSOR_M,
        "lie_rad": vehicle.LIE_RAD,
        "wheel_kgm2": vehicle.WHEEL_KGM2,
        "wheels_kg": one_motor.WHEELS_KG,
        "track_m": vehicle.TRACK_M,
        "upright_kgm2": vehicle.UPRIGHT_KGM2,
        "kg_alone": alone.kg,
        "kg": ridden.kg,
        "kgm_alone": alone.kgm,
        "kgm": ridden.kgm,
        "kgm2_alone": alone.kgm2,
        "kgm2": ridden.kgm2,
        "ahead_alone_rad": alone.ahead_rad,
        "ahead_rad": ridden.ahead_rad,
        "stall_nm": vehicle.STALL_NM,
        "no_load_radps": vehicle.NO_LOAD_RADPS,
        "friction_nm": vehicle.FRICTION_NM,
        "dead": vehicle.DEAD,
        "current_share": vehicle.CURRENT_SHARE,
        "grip": vehicle.GRIP,
        "ice": rides.ICE,
        "kerb_npm": vehicle.KERB_NPM,
        "kerb_nspm": vehicle.KERB_NSPM,
        "carry_per_s2": vehicle.CARRY_PER_S2,
        "carry_per_s": vehicle.CARRY_PER_S,
        "push_radps2_per_mps2": one_motor.PUSH_RADPS2_PER_MPS2,
        "counts_per_turn": float(vehicle.COUNTS_PER_TURN),
        "chatter_ms": float(rides.CHATTER_MS),
        "closed_ms": float(rides.CLOSED_MS),
    }
