"""The 48 ways in which the axes of a sensor can be named: a permutation, and a sign for each axis.

A matrix P (3, 3) has one 1 or -1 in each row; `right = P @ as_read`. Its name has the axis as read, with its sign, for
each of x, y and z: `+y+x+z` swaps x and y.
"""

from __future__ import annotations

import itertools

import numpy as np

from plumb.spec.arrays import FloatArray


def _all() -> FloatArray:
    found = []
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            one = np.zeros((3, 3))
            one[range(3), order] = signs
            found.append(one)
    return np.array(found)


EVERY = _all()
"""(48, 3, 3), the identity first."""
AS_READ = 0
"""Place of the identity in EVERY."""
ALTERED = np.array([np.sum(np.diag(one) != 1.0) for one in EVERY])
"""Axes of each that are not as read."""


def name_of(axes: FloatArray) -> str:
    """`+y+x+z` of a matrix of EVERY."""
    return "".join(("+" if row[at] > 0.0 else "-") + "xyz"[at] for row in axes for at in [int(np.argmax(np.abs(row)))])


def of_name(name: str) -> FloatArray | None:
    """The matrix of a name; None for what is no name."""
    return next((one for one in EVERY if name_of(one) == name), None)


def words_of(axes: FloatArray, sensor: str, other: str) -> str:
    """What the matrix says, axis by axis, of those that are not as read: `gyro x follows accelerometer -y`."""
    said = []
    for row, axis in zip(axes, "xyz", strict=True):
        at = int(np.argmax(np.abs(row)))
        if row["xyz".index(axis)] != 1.0:
            said.append(f"{sensor} {'-' if row[at] < 0.0 else ''}{'xyz'[at]} follows {other} {axis}")
    return ", ".join(said)
