"""A run of `phone`, and the datagrams in which apps of phones send it."""

from __future__ import annotations

import json

import numpy as np

from plumb.systems.phone import scenarios as phone

G = 9.80665
SECONDS = 12.0


def run_of(seed: int = 8) -> phone.Scenario:
    return phone.scenario("general", seed, seconds=SECONDS)


def sensagram(run: phone.Scenario, begin_s: float = 5000.0) -> list[bytes]:
    """One event a datagram; the accelerometer 3 ms after the gyro."""
    found = []
    for k, time_s in enumerate(run.time_s.tolist()):
        for sensor, delay_s, values in (
            ("gyroscope", 0.0, np.radians(run.sensed_dps[:, k])),
            ("accelerometer", 0.003, run.sensed_g[:, k] * G),
        ):
            event = {"type": f"android.sensor.{sensor}", "timestamp": round((begin_s + time_s + delay_s) * 1e9)}
            found.append(json.dumps({**event, "values": [round(float(v), 7) for v in values]}).encode())
    return found


def sensorstream(run: phone.Scenario) -> list[bytes]:
    """All sensors in one datagram, the magnetometer too."""
    rows = zip(run.time_s, (run.sensed_g * G).T, np.radians(run.sensed_dps).T, strict=True)
    return [
        f"{1e5 + t:.5f}, 3, {a[0]:.5f},{a[1]:.5f},{a[2]:.5f}, 4, {w[0]:.6f},{w[1]:.6f},{w[2]:.6f}, 5, 21,-5,38".encode()
        for t, a, w in rows
    ]
