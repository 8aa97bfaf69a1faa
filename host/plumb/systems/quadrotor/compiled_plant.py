"""A drawn run of `quadrotor` as the numbers and signals of plant.c."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from plumb.physics import airframe, cascade, ground, pilots, quadrotor
from plumb.physics.sensors import FAULT_NOISE_LSB, FAULT_RAIL_LSB
from plumb.spec.arrays import FloatArray
from plumb.systems.compiled_plants import DrawnRun
from plumb.systems.quadrotor import courses, vehicle
from plumb.systems.quadrotor.drawn_run import Scenario
from plumb.systems.quadrotor.vehicle import Vehicles

PRESCRIBES = True
_LEANING, _PLACE, _STICKS, _SHUTTLE = range(4)
_STEERS: dict[pilots.Pilot, int] = {pilots.place: _PLACE, pilots.sticks: _STICKS, pilots.shuttle: _SHUTTLE}
_WHATS = tuple(courses.HAPPENINGS)


def drawn(scenario: Scenario, *, open_loop: bool) -> DrawnRun:
    """What the Python plant begins with is read from it. open_loop: the controller that knows the truth flies."""
    begins = Vehicles([scenario], ideal=open_loop)
    numbers = {
        **_times(begins),
        **_frame(begins),
        **_surroundings(begins),
        **begins.imu.numbers(),
        **_course(begins.course),
        **_pilot(begins),
        **_ideal(begins.frame, open_loop=open_loop),
        "turns": float(len(begins.course.turns)),
        "happenings": float(len(begins.course.happenings)),
        "fault_noise_lsb": FAULT_NOISE_LSB,
        "fault_rail_lsb": float(FAULT_RAIL_LSB),
    }
    return DrawnRun(numbers, _signals(scenario, begins), scenario.faults, scenario.steps)


def _sub_step_s(begins: Vehicles) -> float:
    return vehicle.sub_step_us(round(begins.period_s * 1e6)) * 1e-6


def _times(begins: Vehicles) -> Mapping[str, float]:
    return {
        "period_s": begins.period_s,
        "sub_step_s": _sub_step_s(begins),
        "sub_steps": float(round(begins.period_s / _sub_step_s(begins))),
        "rest_s": courses.REST_S,
        "acts_s": begins.course.acts_s,
        "sag_s": courses.SAG_S,
    }


def _frame(begins: Vehicles) -> Mapping[str, float]:
    frame = begins.frame
    return {
        "mass_kg": frame.mass_kg,
        "thrust_ns2": frame.thrust_ns2,
        "speed_max_radps": frame.speed_max_radps,
        "rotor_drag_kg": frame.rotor_drag_kg,
        "rolling_moment_kgm": frame.rolling_moment_kgm,
        "rises": -math.expm1(-_sub_step_s(begins) / frame.lag_up_s),
        "falls": -math.expm1(-_sub_step_s(begins) / frame.lag_down_s),
        "drag_kgpm": -0.5 * airframe.AIR_KGPM3 * frame.drag_area_m2,
        "drag_above_m": frame.drag_above_m,
        "hover_radps": frame.hover_radps,
        "hover_command": vehicle.hover_command(frame, begins.course.supply),
        "thrust_max_n": frame.thrust_max_n,
        "weight_n": frame.weight_n,
        "gravity_mps2": airframe.G_MPS2,
        "thrust_square": airframe.THRUST_SQUARE,
        "thrust_linear": airframe.THRUST_LINEAR,
        "tiny_rad": quadrotor.TINY_RAD,
    }


def _surroundings(begins: Vehicles) -> Mapping[str, float]:
    frame = begins.frame
    return {
        "lands": float(begins.course.lands),
        "reach_m": begins.ground.reach_m,
        "leg_spring_npm": frame.leg_spring_npm,
        "leg_damper_nspm": frame.leg_damper_nspm,
        "leg_down_m": frame.leg_down_m,
        "friction": ground.FRICTION,
        "creep_mps": ground.CREEP_MPS,
        "wind_mps": begins.wind.speed_mps,
        "east": float(begins.wind.along[0, 0]),
        "north": float(begins.wind.along[1, 0]),
    }


def _course(course: courses.Course) -> Mapping[str, float]:
    return {
        "held": float(course.held),
        "vibration_g": course.vibration_g,
        "supply": course.supply,
        "climb_m": course.climb_m,
        "climb_mps": courses.CLIMB_MPS,
        "sink_mps": course.sink_mps,
        "land_at_s": course.land_at_s,
        "touched_m": course.touched_m,
        "keeps_on_s": course.keeps_on_s,
    }


def _pilot(begins: Vehicles) -> Mapping[str, float]:
    pilot = begins.course.pilot
    leans = pilot if isinstance(pilot, pilots.Leaning) else pilots.centred
    return {
        "pilot": float(_LEANING if isinstance(pilot, pilots.Leaning) else _STEERS[pilot]),
        "lean_roll_rad": leans.roll_rad,
        "lean_pitch_rad": leans.pitch_rad,
        "lean_yaw_radps": leans.yaw_radps,
        "lean_until_s": leans.until_s,
        "seen_steps": float(vehicle.seen_steps(begins.period_s)),
        "lean_max_rad": float(pilots.LEAN_MAX_RAD),
        "place_per_s2": pilots.PLACE_PER_S2,
        "speed_per_s": pilots.SPEED_PER_S,
        "place_sum_per_s3": pilots.PLACE_SUM_PER_S3,
        "place_sum_most_ms": vehicle.PLACE_SUM_MOST_MS,
        "sticks_rad": pilots.STICKS_DEG * pilots.DEG,
        "sticks_every_s": pilots.STICKS_EVERY_S,
        "shuttle_rad": pilots.SHUTTLE_DEG * pilots.DEG,
        "shuttle_s": pilots.SHUTTLE_S,
        "height_per_s2": pilots.HEIGHT_PER_S2,
        "climb_per_s": pilots.CLIMB_PER_S,
        "height_sum_per_s3": pilots.HEIGHT_SUM_PER_S3,
        "height_sum_most_ms": pilots.SUM_LIMIT_MS,
        "thrust_most_n": pilots.THRUST_MOST * begins.frame.thrust_max_n,
        "frame_s": vehicle.FRAME_S,
        "frame_numbers": float(vehicle.NUMBERS),
        "full": float(vehicle.FULL_Q15),
        "stick_lean": vehicle.STICK_LEAN,
        "stick_rate_dps": vehicle.STICK_RATE_DPS,
        "stick_yaw_dps": vehicle.STICK_YAW_DPS,
    }


def _ideal(frame: airframe.Airframe, *, open_loop: bool) -> Mapping[str, float]:
    return {
        "ideal": float(open_loop),
        "attitude_gain": cascade.ATTITUDE_GAIN,
        "rate_gain": cascade.RATE_GAIN,
        "yaw_gain": cascade.YAW_GAIN,
        "rate_integral": cascade.RATE_INTEGRAL,
        "rate_limit_radps": float(cascade.RATE_LIMIT_RADPS),
        "integral_limit_rad": cascade.INTEGRAL_LIMIT_RAD,
        "yaw_limit": cascade.YAW_LIMIT,
        "moment_m": frame.moment_m,
        "idle": cascade.IDLE,
    }


def _signals(scenario: Scenario, begins: Vehicles) -> Mapping[str, FloatArray]:
    sensors, wind, course = begins.imu, begins.wind, begins.course
    happenings = [(_WHATS.index(one.what), one.begin_s, one.end_s, one.size, one.number) for one in course.happenings]
    share = begins.period_s / wind.scale_s
    return {
        "inertia": np.array(begins.frame.inertia_kgm2),
        "torques": begins.frame.allocation()[1:],
        "thrusts": np.linalg.inv(begins.frame.allocation()),
        "legs": begins.ground.legs.T,
        "normal": begins.ground.normal,
        "attitude": begins.body.attitude,
        "begin_m": begins.begin_m,
        "phase_rad": scenario.phase_rad,
        "gusts_kept": np.concatenate([wind.straight_mps, wind.first_mps[:, 0], wind.second_mps[:, 0]]),
        "gusts_share": share,
        "gusts_new": wind.sigma_mps * np.sqrt(np.stack([2.0 * share[0], share[1], share[2]])),
        "gyro_matrix": sensors.matrix,
        "gyro_bias_dps": sensors.bias_dps,
        "gyro_warm_up_dps": sensors.warm_up_dps,
        "accel_offset_g": sensors.offset_g,
        "turns": np.array([(one.begin_s, one.end_s, *one.rate_dps) for one in course.turns], np.float64),
        "happenings": np.array(happenings, np.float64),
        "sticks": scenario.sticks,
        "noise": scenario.noise,
        "fault_noise": scenario.fault_noise,
    }
