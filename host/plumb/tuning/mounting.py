"""How a three-axis sensor is mounted: its axis map and its 3x3 matrix, as parameters of a system.

A system that wants it declares a group of nine parameters, xx_q30 to zz_q30, with the struct plumb_mounting_params_t
(CONTRIBUTING.md, "Add a system"), and calls plumb_mounting_apply on its calibrated values.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from plumb.errors import UsageError
from plumb.kernels.fixed import mounting

FloatArray = npt.NDArray[np.float64]
AXES = ("x", "y", "z")


def axis_map(text: str) -> FloatArray:
    """The matrix (3, 3) of a map like "y,-x,z": body x is the sensor's y, body y its -x, body z its z.

    Raises UsageError for a map that is not one of the 24 ways to mount a sensor.
    """
    named = [part.strip() for part in text.split(",")]
    bare = [part.lstrip("+-") for part in named]
    if sorted(bare) != list(AXES) or any(len(part) - len(name) > 1 for part, name in zip(named, bare, strict=True)):
        raise UsageError(f"'{text}' is no axis map: name each axis of the sensor once, with its sign, as in y,-x,z")
    matrix = np.zeros((3, 3))
    for row, part in enumerate(named):
        matrix[row, AXES.index(part[-1])] = -1.0 if part.startswith("-") else 1.0
    if np.linalg.det(matrix) < 0.0:
        raise UsageError(f"'{text}' mirrors the sensor: no rotation turns its axes so; change one sign")
    return matrix


def mounting_words(group: str, matrix: Sequence[Sequence[float]] | FloatArray) -> dict[str, int]:
    """Parameters of the group. matrix: (3, 3), from sensor axes to the body's; an axis map, times what corrects scale
    and misalignment. Raises UsageError for a matrix that mounts no sensor."""
    entries = np.asarray(matrix, np.float64)
    if entries.shape != (3, 3) or not np.isfinite(entries).all():
        raise UsageError(f"{group}: a mounting is a matrix of 3 x 3 finite numbers, not {entries.shape}")
    if np.max(np.abs(entries)) >= 2.0:
        raise UsageError(
            f"{group}: an entry of {np.max(np.abs(entries)):g} is 2 or more: gain belongs to the calibration"
        )
    words = np.rint(entries * mounting.ONE_Q30).astype(np.int64).ravel().tolist()
    found = dict(zip((f"{group}.{name}" for name in mounting.NAMES), words, strict=True))
    if not mounting.valid(found, group):
        determinant = np.linalg.det(entries)
        raise UsageError(
            f"{group}: the absolute values of a row sum to 2 or more, or the determinant, {determinant:.3g}, is not "
            "between 1/2 and 2"
        )
    return found


def is_turned(matrix: Sequence[Sequence[float]] | FloatArray) -> bool:
    """False for the identity, which leaves every value as it is."""
    return not np.array_equal(np.asarray(matrix, np.float64), np.eye(3))


def matrix_of(words: dict[str, int], group: str) -> FloatArray:
    """The matrix that the parameters mean, (3, 3)."""
    return np.array([words[f"{group}.{name}"] for name in mounting.NAMES], np.float64).reshape(3, 3) / mounting.ONE_Q30
