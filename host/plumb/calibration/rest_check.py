"""Is all well with a board that runs on its own sensors, at rest and disarmed? What `plumb setup` ends with."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import fmean

from plumb.errors import counted
from plumb.link import monitor
from plumb.link.monitor import Snapshot
from plumb.link.session import Session
from plumb.spec.parameter_file import by_name

SETTLE_S = 3.0
"""Time that the filter gets to find the gyro's bias."""
LOOK_S = 2.0
RATE_TOLERANCE = 0.02
"""Share of the steps per second."""
MOST_RATE_DPS = 3.0
MOST_TILT_ERROR_DEG = 2.0
"""Between the tilt and that of the accelerometer alone, means over LOOK_S, at rest."""


def examine(session: Session) -> tuple[Snapshot, list[str]]:
    """Begin a run on the board's own sensors, and end it after some seconds. Returns the last state, and what is not
    well, in sentences; none when the light is green. Raises LinkError when the board falls silent."""
    period_us = by_name(session.read_parameters())["period_us"]
    monitor.begin_live(session)
    try:
        shown = list(monitor.watch(session, SETTLE_S + LOOK_S))
    finally:
        session.end()
    looks = shown[-round(LOOK_S / monitor.EVERY_S) :]
    return looks[-1], troubles(looks, 1e6 / period_us)


def troubles(looks: Sequence[Snapshot], steps_per_s: float) -> list[str]:
    """Troubles in these states, one after the other."""
    last = looks[-1]
    found = [f"fault: {text}" for text in last["faults"]]
    if not last["live"]:
        found.append("the board does not run on its own sensors")
    rate = last["steps_per_s"]
    if rate is None or abs(rate / steps_per_s - 1.0) > RATE_TOLERANCE:
        shown = "no" if rate is None else f"{rate:.1f}"
        found.append(f"{shown} steps per second instead of {steps_per_s:.1f}")
    for name, text in (
        ("host_lost", ("frame was lost", "frames were lost")),
        ("board_dropped", ("frame did not fit the link", "frames did not fit the link")),
    ):
        first, late = looks[0][name], last[name]
        if late is not None and first is not None and late > first:
            found.append(f"{counted(late - first, *text)}: check the link with `plumb link-test`")
    if (last["saturated_steps"] or 0) > (looks[0]["saturated_steps"] or 0):
        found.append("raw counts are outside their range: check the sensors' wires and supply")
    turning = _mean(looks, "rate_dps")
    if turning is not None and abs(turning) > MOST_RATE_DPS:
        found.append(f"a rate of {turning:+z.1f} deg/s at rest: hold it still, or calibrate the gyro")
    tilt, measured = _mean(looks, "tilt_deg"), _mean(looks, "tilt_measured_deg")
    if tilt is not None and measured is not None and abs(tilt - measured) > MOST_TILT_ERROR_DEG:
        off = f"the tilt is {tilt:+z.1f} deg, and {measured:+z.1f} deg by the accelerometer"
        found.append(f"{off}: check axes and signs")
    return found


def _mean(looks: Sequence[Snapshot], name: str) -> float | None:
    values = [look[name] for look in looks if look[name] is not None]
    return fmean(values) if values else None
