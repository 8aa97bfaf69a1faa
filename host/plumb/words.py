"""The words of a step: raw inputs, intermediates and outputs, in the written order that digests are taken over.

One numpy record per step and system, little endian, without padding: the same bytes as the firmware's struct. The order
is that of DESIGN.md, "Numbers"; a test holds it equal to the name list the C exports. Every record begins with the raw
counts and the setpoint as given, and ends with the flags and the number of the step.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator, Mapping

import numpy as np
import numpy.typing as npt

from plumb.errors import UsageError

KALMAN = [
    ("turn_q61", "<i8"),
    ("bias_turn_q61", "<i8"),
    ("p00", "<i8"),
    ("p01", "<i8"),
    ("p11", "<i8"),
    ("p11_frac_q30", "<u4"),
    ("innovation_turn_q32", "<i4"),
    ("k0_q29", "<i4"),
    ("k1_q29", "<i4"),
]
"""The words of one filter (kalman_t), behind the angle's name."""

CONTROLLER = [
    ("integral_q54", "<i8"),
    ("command_q22", "<i4"),
    ("rate_filtered_turnps_q27", "<i4"),
    ("excess_q22", "<i4"),
    ("error_turn_q32", "<i4"),
]
"""The words of the controller of an angle (pid_t)."""

ONE_AXIS = [
    ("tilt_measured_turn_q32", "<i4"),
    ("variance", "<u4"),
    ("tilt_turn_q61", "<i8"),
    *KALMAN[1:],
    ("tilt_turn_q32", "<i4"),
    ("bias_turnps_q28", "<i4"),
    ("rate_corrected_turnps_q28", "<i4"),
    ("clamped_steps", "<u4"),
]
"""The estimate of one axis: measured, filtered, published."""


QUAD = np.dtype(
    [
        *((f"raw_{i}", "<i4") for i in range(6)),
        ("setpoint_turn_q32", "<i4"),
        ("rate_turnps_q28", "<i4"),
        ("accel_y_g_q26", "<i4"),
        ("accel_z_g_q26", "<i4"),
        *ONE_AXIS,
        *CONTROLLER,
        ("pulse_halfus_0", "<u4"),
        ("pulse_halfus_1", "<u4"),
        ("flags", "<u4"),
        ("step", "<u4"),
    ]
)


BALANCER = np.dtype(
    [
        *((f"raw_{i}", "<i4") for i in range(6)),
        ("setpoint_mps_q26", "<i4"),
        ("rate_turnps_q28", "<i4"),
        ("accel_x_g_q26", "<i4"),
        ("accel_z_g_q26", "<i4"),
        ("speed_mps_q26", "<i4"),
        ("velocity_mps_q26", "<i4"),
        ("wheel_accel_g_q26", "<i4"),
        ("gravity_x_g_q26", "<i4"),
        *ONE_AXIS,
        ("speed_integral_q54", "<i8"),
        ("speed_command_q22", "<i4"),
        ("accel_filtered_g_q25", "<i4"),
        ("speed_excess_q22", "<i4"),
        ("speed_error_mps_q26", "<i4"),
        *CONTROLLER,
        ("lean_turn_q32", "<i4"),
        ("duty_q15", "<i4"),
        ("flags", "<u4"),
        ("step", "<u4"),
    ]
)

PHONE = np.dtype(
    [
        *((f"raw_{i}", "<i4") for i in range(6)),
        ("setpoint_turn_q32", "<i4"),
        ("rate_x_turnps_q28", "<i4"),
        ("rate_y_turnps_q28", "<i4"),
        ("rate_z_turnps_q28", "<i4"),
        ("accel_x_g_q26", "<i4"),
        ("accel_y_g_q26", "<i4"),
        ("accel_z_g_q26", "<i4"),
        ("tangent_q26", "<i4"),
        ("pitch_rate_turnps_q28", "<i4"),
        ("roll_rate_turnps_q28", "<i4"),
        ("pitch_measured_turn_q32", "<i4"),
        ("roll_measured_turn_q32", "<i4"),
        ("pitch_variance", "<u4"),
        ("roll_variance", "<u4"),
        *((f"{axis}_{name}", kind) for axis in ("pitch", "roll") for name, kind in KALMAN),
        ("pitch_turn_q32", "<i4"),
        ("pitch_bias_turnps_q28", "<i4"),
        ("pitch_rate_corrected_turnps_q28", "<i4"),
        ("roll_turn_q32", "<i4"),
        ("roll_bias_turnps_q28", "<i4"),
        ("roll_rate_corrected_turnps_q28", "<i4"),
        ("uncorrected_steps", "<u4"),
        ("clamped_steps", "<u4"),
        ("flags", "<u4"),
        ("step", "<u4"),
    ]
)


def _three(name: str, kind: str = "<i4") -> list[tuple[str, str]]:
    return [(f"{name}_{axis}", kind) for axis in range(3)]


def _parameter(name: str, axis: int) -> list[tuple[str, str]]:
    touched = ("rate_q28", "gyro_bias_q28", "angular_bias_q28", "angle_q28")
    return [(f"{name}_variance_q60_{axis}", "<i8"), *((f"{name}_{state}_{axis}", "<i4") for state in touched)]


TURNTABLE = np.dtype(
    [
        *((f"raw_{i}", "<i4") for i in range(6)),
        ("setpoint", "<i4"),
        *(
            field
            for sensor in ("gyro", "angular")
            for field in (
                *_three(f"{sensor}_last"),
                *_three(f"{sensor}_before"),
                (f"{sensor}_spikes", "<u4"),
                (f"{sensor}_gap_steps", "<u4"),
            )
        ),
        *_three("rate_turnps_q28"),
        *_three("acceleration_turnps2_q28"),
        ("gyro_age_step_q24", "<u4"),
        *_three("increment_turnps_q34"),
        *_three("increment_lagged_turnps_q34"),
        *_three("innovation_turnps_q28"),
        *((f"{name}_{axis}_q30", "<i4") for name in ("attitude", "attitude_angular") for axis in "wxyz"),
        *_three("rate_fused_turnps_q28"),
        *_three("rate_corrected_turnps_q28"),
        *_three("bias_gyro_turnps_q34"),
        *_three("bias_angular_turnps_q42"),
        *_three("scale_q30"),
        *_three("lag_step_q24"),
        ("clamped_steps", "<u4"),
        *((f"p{i}{j}_q64", "<i8") for i in range(5) for j in range(min(i + 1, 4))),
        *(field for name in ("scale", "lag") for axis in range(3) for field in _parameter(name, axis)),
        ("flags", "<u4"),
        ("step", "<u4"),
    ]
)


RECORDS: dict[str, np.dtype[np.void]] = {"quad": QUAD, "balancer": BALANCER, "turntable": TURNTABLE, "phone": PHONE}
"""The record of each system; the order of the names is that of the parameter `system`."""


def names_of(system: str) -> tuple[str, ...]:
    """The words of a system's step in the written order."""
    return RECORDS[system].names or ()


def packer(system: str) -> struct.Struct:
    """Packs the values of one step, in the written order, into the bytes that the digest is taken over."""
    kinds = {"i4": "i", "u4": "I", "i8": "q", "u8": "Q"}
    return struct.Struct("<" + "".join(kinds[RECORDS[system][name].str[1:]] for name in names_of(system)))


class Words(Mapping[str, npt.NDArray[np.int64]]):
    """Name -> int64 array of shape (steps,) or (steps, runs), backed by one packed record array of one system."""

    def __init__(self, record: npt.NDArray[np.void]) -> None:
        if record.dtype not in RECORDS.values():
            raise UsageError(f"no system's step is a record of {record.dtype}")
        self.record = np.ascontiguousarray(record)

    @classmethod
    def from_bytes(cls, data: bytes | bytearray | memoryview, shape: tuple[int, ...], system: str) -> Words:
        """From the packed bytes of the firmware's struct, steps (then runs) in C order."""
        return cls(np.frombuffer(data, RECORDS[system]).reshape(shape))

    @property
    def system(self) -> str:
        return next(name for name, dtype in RECORDS.items() if dtype == self.record.dtype)

    @property
    def names(self) -> tuple[str, ...]:
        return self.record.dtype.names or ()

    def __getitem__(self, name: str) -> npt.NDArray[np.int64]:
        return self.record[name].astype(np.int64)

    def __iter__(self) -> Iterator[str]:
        return iter(self.names)

    def __len__(self) -> int:
        return len(self.names)

    def digests(self) -> npt.NDArray[np.uint32]:
        """CRC-32 of every step's bytes, shape (steps,) or (steps, runs)."""
        size = self.record.dtype.itemsize
        data = memoryview(self.record.tobytes())
        crcs = [zlib.crc32(data[at : at + size]) for at in range(0, len(data), size)]
        return np.array(crcs, np.uint32).reshape(self.record.shape)
