"""Mounting of a three-axis sensor: axis maps to the bit, the C core against the integers in Python, refusals."""

from __future__ import annotations

import ctypes
import itertools

import numpy as np
import pytest

from plumb.errors import UsageError
from plumb.kernels.fixed import mounting
from plumb.tuning.mounting import axis_map, matrix_of, mounting_words
from support import link_functions

IDENTITY = mounting_words("gyro_mounting", np.eye(3))


def in_c(words: dict[str, int], v: tuple[int, int, int]) -> tuple[tuple[int, ...], bool, bool]:
    """The vector, whether it was limited, and whether the matrix is valid, as the C core says."""
    core = link_functions.library()
    core.plumb_mounting_apply.restype = core.plumb_mounting_valid.restype = ctypes.c_bool
    matrix, vector = (ctypes.c_int32 * 9)(*words.values()), (ctypes.c_int32 * 3)(*v)
    within = core.plumb_mounting_apply(matrix, vector)
    return tuple(vector), not within, bool(core.plumb_mounting_valid(matrix))


def wild(rng: np.random.Generator) -> dict[str, int]:
    """A matrix near a mounting, or far from one."""
    if rng.random() < 0.5:
        entries = np.eye(3)[rng.permutation(3)] * rng.choice([-1.0, 1.0], 3) + rng.normal(0.0, 0.1, (3, 3))
    else:
        entries = rng.uniform(-0.9, 0.9, (3, 3))
    words = np.rint(entries * 2.0**30).astype(np.int64).ravel().tolist()
    return dict(zip(IDENTITY, words, strict=True))


def test_the_integers_are_those_of_the_c_core() -> None:
    rng = np.random.default_rng(5)
    seen = {"limited": 0, "valid": 0}
    for _ in range(3000):
        words = wild(rng)
        if any(sum(abs(value) for value in list(words.values())[at : at + 3]) >= 1 << 31 for at in (0, 3, 6)):
            continue
        scale = 2.0 ** (rng.uniform(0, 31) if rng.random() < 0.5 else 31)
        v = tuple(int(value) for value in np.clip(rng.uniform(-scale, scale, 3), -mounting.LIMIT, mounting.LIMIT))
        assert len(v) == 3
        vector, limited, valid = in_c(words, v)
        assert (vector, limited) == mounting.mount(words, "gyro_mounting", v)
        assert valid == mounting.valid(words, "gyro_mounting")
        seen["limited"] += limited
        seen["valid"] += valid
    # Of 3000 drawn, enough of both: a matrix that limits, and one that is valid.
    assert min(seen.values()) > 50


def test_24_axis_maps_move_values_to_the_bit() -> None:
    v, taken = (12345, -7654321, mounting.LIMIT), 0
    for order in itertools.permutations("xyz"):
        for signs in itertools.product(("", "-"), repeat=3):
            text = ",".join(sign + axis for sign, axis in zip(signs, order, strict=True))
            try:
                words = mounting_words("m", axis_map(text))
            except UsageError as refused:
                assert "mirrors the sensor" in str(refused)
                continue
            taken += 1
            wanted = tuple((-1 if sign else 1) * v["xyz".index(axis)] for sign, axis in zip(signs, order, strict=True))
            assert mounting.mount(words, "m", v) == (wanted, False)
    assert taken == 24
    assert mounting_words("gyro_mounting", axis_map("x,+y, z")) == IDENTITY


def test_the_matrix_is_within_half_a_unit_of_float64() -> None:
    rng = np.random.default_rng(7)
    words = mounting_words("m", np.eye(3) + rng.normal(0.0, 0.02, (3, 3)))
    for v in rng.integers(-(1 << 28), 1 << 28, (200, 3)).tolist():
        found, _ = mounting.mount(words, "m", tuple(v))
        assert np.max(np.abs(np.array(found) - matrix_of(words, "m") @ v)) <= 0.5 + 1e-6


@pytest.mark.parametrize("text", ["", "x,y", "x,y,y", "x,y,w", "x,y,--z", "xyz"])
def test_what_is_no_axis_map_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match="is no axis map: name each axis"):
        axis_map(text)


@pytest.mark.parametrize(
    ("matrix", "why"),
    [
        (np.zeros((3, 3)), "the determinant, 0,"),
        (np.diag([-1.0, 1.0, 1.0]), "the determinant, -1,"),
        (np.diag([2.5, 1.0, 1.0]), "an entry of 2.5 is 2 or more"),
        (np.eye(3) + np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]), "of a row sum to 2 or more"),
        (np.eye(2), "3 x 3 finite numbers"),
        (np.diag([1.0, 1.0, np.nan]), "3 x 3 finite numbers"),
    ],
)
def test_a_matrix_that_mounts_no_sensor_is_refused(matrix: np.ndarray, why: str) -> None:
    with pytest.raises(UsageError, match=why):
        mounting_words("m", matrix)
