"""Fit the polynomials and the square-root table of firmware/core/angle.[ch]; print them, or check that they have them.

    python tools/fit_angle.py            print the C tables
    python tools/fit_angle.py --check    exit 1 unless these two files hold exactly these numbers

Minimax by the exchange algorithm of Remez in float64; angles are in turns, so that the integers are binary angles.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt

SOURCES = [Path(__file__).resolve().parent.parent / "firmware" / "core" / name for name in ("angle.h", "angle.c")]
ATAN_TERMS, ATAN_Q = 8, 33  # atan(t) = t * P(t^2), 0 <= t <= 1
ASIN_TERMS, ASIN_Q = 7, 32  # asin(x) = 1/4 - sqrt(1 - x) * P(x), 0 <= x <= 1, with P(0) = 1/4
SIN_TERMS, SIN_Q = 4, 31  # sin(pi/4 x) = x * P(x^2), 0 <= x <= 1
COS_TERMS, COS_Q = 4, 32  # cos(pi/4 x) = 1 - x^2 * P(x^2), 0 <= x <= 1
PER_UNIT = 32  # segments of 1/sqrt(w) per unit of w, for 1 <= w < 4

Array = npt.NDArray[np.float64]
Function = Callable[[Array], Array]


def remez(f: Function, weight: Function, terms: int) -> Array:
    """Coefficients c of sum c_k x^k minimising max |weight(x) (f(x) - p(x))| on [0, 1], lowest power first."""
    grid = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, 20001))
    nodes = 0.5 - 0.5 * np.cos(np.pi * (np.arange(terms + 1) + 0.5) / (terms + 1))
    coefficients = np.zeros(terms)
    for _ in range(30):
        matrix = np.vander(nodes, terms, increasing=True) * weight(nodes)[:, None]
        level = (-1.0) ** np.arange(terms + 1)
        solution = np.linalg.solve(np.column_stack([matrix, level]), weight(nodes) * f(nodes))
        coefficients = np.asarray(solution[:terms], np.float64)
        error = weight(grid) * (f(grid) - np.polynomial.polynomial.polyval(grid, coefficients))
        edges = np.flatnonzero(np.sign(error[1:]) != np.sign(error[:-1])) + 1
        pieces = np.split(np.arange(grid.size), edges)
        peaks = np.array([piece[np.argmax(np.abs(error[piece]))] for piece in pieces])
        while peaks.size > terms + 1:
            peaks = peaks[1:] if abs(error[peaks[0]]) < abs(error[peaks[-1]]) else peaks[:-1]
        if peaks.size < terms + 1:
            break
        nodes = grid[peaks]
    return coefficients


def atan_over_t(z: Array) -> Array:
    t = np.sqrt(np.maximum(z, 1e-18))
    return np.arctan(t) / t / (2 * np.pi)


def acos_over_root(x: Array) -> Array:
    """(acos(x) / sqrt(1 - x) - 1/4) / x: the function to fit when P(0) is fixed."""
    x = np.clip(x, 1e-6, 1.0 - 1e-12)
    return (np.arccos(x) / np.sqrt(1.0 - x) / (2 * np.pi) - 0.25) / x


def sin_over_x(z: Array) -> Array:
    x = np.sqrt(np.maximum(z, 1e-18))
    return np.sin(np.pi / 4 * x) / x


def versine_over_square(z: Array) -> Array:
    z = np.maximum(z, 1e-6)
    return (1.0 - np.cos(np.pi / 4 * np.sqrt(z))) / z


def sin_table() -> list[int]:
    return [round(float(c) * 2**SIN_Q) for c in remez(sin_over_x, np.sqrt, SIN_TERMS)]


def cos_table() -> list[int]:
    return [round(float(c) * 2**COS_Q) for c in remez(versine_over_square, lambda z: z + 1e-9, COS_TERMS)]


def atan_table() -> list[int]:
    fit = remez(atan_over_t, np.sqrt, ATAN_TERMS)
    return [round(float(c) * 2**ATAN_Q) for c in fit]


def asin_table() -> list[int]:
    fit = remez(acos_over_root, lambda x: x * np.sqrt(1.0 - x) + 1e-9, ASIN_TERMS - 1)
    return [2 ** (ASIN_Q - 2)] + [round(float(c) * 2**ASIN_Q) for c in fit]


def root_table() -> list[int]:
    """1/sqrt(w) in segments of w: value at the left end (Q16, upper half of the word), decrease over the segment (Q16).

    The chord is lowered by half its largest error, so that positive and negative errors are equal.
    """
    table = []
    for i in range(PER_UNIT, 4 * PER_UNIT):
        w = np.linspace(i / PER_UNIT, (i + 1) / PER_UNIT, 1001)
        curve = 1.0 / np.sqrt(w)
        chord = curve[0] + (curve[-1] - curve[0]) * np.linspace(0.0, 1.0, 1001)
        left = curve[0] - float(np.max(chord - curve)) / 2.0
        table.append((min(round(left * 2**16), 65535) << 16) | round((curve[0] - curve[-1]) * 2**16))
    return table


def rows(name: str, kind: str, numbers: list[int], per_line: int) -> str:
    text = [f"{n:#010x}U" if kind == "uint32_t" else str(n) for n in numbers]
    lines = [", ".join(text[i : i + per_line]) for i in range(0, len(text), per_line)]
    return f"static const {kind} {name}[{len(numbers)}] = {{\n    " + ",\n    ".join(lines) + "};\n"


def numbers_in(name: str, source: str) -> list[int]:
    match = re.search(rf"{name}\[\d+\] = \{{(.*?)\}}", source, re.S)
    return [int(n.rstrip("U"), 0) for n in re.findall(r"-?(?:0x)?[0-9a-f]+U?", match.group(1))] if match else []


def main() -> int:
    tables = {"ANGLE_ATAN_Q33": atan_table(), "ANGLE_ASIN_Q32": asin_table(), "plumb_angle_root": root_table()}
    tables |= {"SIN_Q31": sin_table(), "COS_Q32": cos_table()}
    if "--check" not in sys.argv[1:]:
        for name, numbers in tables.items():
            print(rows(name, "uint32_t" if name == "plumb_angle_root" else "int32_t", numbers, 6))
        return 0
    source = "".join(path.read_text() for path in SOURCES)
    stale = [name for name, numbers in tables.items() if numbers_in(name, source) != numbers]
    if stale:
        print(f"angle.[ch]: {', '.join(stale)} differ from the fit; paste what tools/fit_angle.py prints")
    return 1 if stale else 0


if __name__ == "__main__":
    sys.exit(main())
