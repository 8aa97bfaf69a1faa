"""One look of `plumb monitor` as a line of text, and the values that every view of it shows."""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from plumb.link.monitor import Snapshot

LINE_COLUMNS = {
    "tilt_deg", "tilt_measured_deg", "rate_dps", "bias_dps", "command", "duty", "flags", "velocity_mps",
    "roll_deg", "roll_bias_dps", "w", "x", "y", "z", "rate_x_dps", "rate_y_dps", "rate_z_dps",
}  # fmt: skip
"""Columns that a line shows under a name of its own, or not at all; the others are shown under their own."""


def name_and_unit(column: str) -> tuple[str, str]:
    """`tilt_measured_deg` -> ("tilt measured", "deg")."""
    from plumb.spec.signals import UNITS

    for unit, suffix in UNITS.items():
        if column.endswith(suffix):
            return column.removesuffix(suffix).replace("_", " "), unit
    return column.replace("_", " "), ""


def number(value: float, unit: str) -> str:
    return f"{value:+z.3f} {unit}".rstrip()


def count(value: int | None) -> str:
    return "-" if value is None else str(value)


def mode(snapshot: Snapshot) -> str:
    """IDLE, LOCKSTEP, REALTIME, and `live` for a run on the board's own sensors."""
    return " ".join(filter(None, [snapshot["mode"] or "-", "live" if snapshot["live"] else ""]))


def armed(snapshot: Snapshot) -> str:
    return "ARMED" if snapshot["armed"] else "disarmed"


def angles_deg(quaternion: list[float]) -> tuple[float, float, float]:
    """Yaw, pitch and roll in deg (rotation order z, y, x) of a quaternion w, x, y, z."""
    w, x, y, z = quaternion
    yaw = math.degrees(math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))
    pitch = math.degrees(math.asin(min(max(2 * (w * y - z * x), -1.0), 1.0)))
    roll = math.degrees(math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)))
    return yaw, pitch, roll


PULSE = re.compile(r"pulse_\d+_us")


def pulses(s: Snapshot) -> str:
    """Of all outputs that send one, in order; "" for none."""
    known = [s[name] for name in sorted(filter(PULSE.fullmatch, s)) if s[name] is not None]
    return " ".join(f"{value:.1f}" for value in known) + " us" if known else ""


def motors(s: Snapshot) -> str:
    """Of a vehicle on wheels, in per cent of full drive, positive forward; while the board is disarmed what the step
    asks for, which nothing drives."""
    duties = " ".join(f"{name} {100.0 * duty:+z.0f} %" for name, duty in s["motors"].items())
    return f"motors {duties}" if s["armed"] else f"motors not driven, asked for {duties}"


def line(s: Snapshot) -> str:
    """The look as one line, for a file or a pipe."""
    from plumb.link.monitor import columns

    lost = s["host_lost"] + s["host_lost_steps"]
    trouble = [f"lost {lost}"] if lost else []
    trouble += [f"rejected {s['host_rejected']}"] if s["host_rejected"] else []
    trouble += [f"dropped {s['board_dropped']}"] if s["board_dropped"] else []
    trouble += [f"saturated {s['saturated_steps']}"] if s["saturated_steps"] else []
    trouble += s["faults"]
    yaw, pitch, roll = angles_deg(s["attitude"]) if s["attitude"] else (None, None, s["roll_deg"])
    values = [
        ("tilt", s["tilt_deg"], "deg"),
        ("yaw", yaw, "deg"),
        ("pitch", pitch, "deg"),
        ("roll", roll, "deg"),
        ("rate", s["rate_dps"], "deg/s"),
        ("bias", s["bias_dps"], "deg/s"),
        ("duty", s["duty"], ""),
        ("velocity", s["velocity_mps"], "m/s"),
        *(
            (name_and_unit(name)[0], s[name], name_and_unit(name)[1])
            for name in s
            if name in columns()
            and name not in {*LINE_COLUMNS, *s["choices"], *s["motors"]}
            and not PULSE.fullmatch(name)
        ),
    ]
    words = [f"{s['time_s']:.2f} s", f"{mode(s)} {armed(s)}"]
    words += [f"{name} {number(value, unit)}" for name, value, unit in values if value is not None]
    if pulses(s) and s["duty"] is None:
        words.append(f"pulses {pulses(s)}")
    words += [motors(s)] if s["motors"] else []
    words += [f"{name}: {text}" for name, text in s["choices"].items()]
    if s["step"] is not None:
        words.append(f"step {s['step']}")
    if s["battery_v"] is not None:
        words.append(f"battery {s['battery_v']:.2f} V")
    blocked = [f"not armed: {'; '.join(s['blocked'])}"] if s["blocked"] and not s["armed"] else []
    return "  ".join(words + trouble + blocked)
