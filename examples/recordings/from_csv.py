"""Convert a CSV of an IMU for plumb: python from_csv.py IN.csv OUT.npz. The names and units below are your file's."""

import csv
import sys
from math import radians
from pathlib import Path

import numpy as np

SEPARATOR = ","
TIME, TIME_UNIT_S = "ms", 1e-3  # column of time, and seconds in one of its units; TIME = "": evenly spaced
RATE_HZ = 0.0  # samples a second where no column has the time
GYRO, GYRO_UNIT_RADPS = ("gx", "gy", "gz"), radians(1.0)  # the columns in deg/s; 1.0 where they are in rad/s
ACCEL, ACCEL_UNIT_MPS2 = ("ax", "ay", "az"), 9.80665  # the columns in g; 1.0 where they are in m/s^2
REFERENCE = ("qw", "qx", "qy", "qz")  # the true attitude, w first, from the body to an earth frame with z up; or ()
AXES = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1]])  # x, y, z of the body, a row each, by the axes of the columns


def columns(names: tuple[str, ...]) -> np.ndarray:
    """The named columns, (N, names); NaN where a cell is empty."""
    found = np.full((len(rows), len(names)), np.nan)
    for line, row in enumerate(rows, 2):
        for column, name in enumerate(names):
            cell = (row[name] or "").strip()
            try:
                found[line - 2, column] = float(cell or "nan")
            except ValueError:
                sys.exit(f"{sys.argv[1]}, line {line}: '{cell}' in column {name} is not a number")
    return found


if len(sys.argv) != 3:
    sys.exit(__doc__)
try:
    with Path(sys.argv[1]).open(newline="", encoding="utf-8-sig") as source:
        table = csv.DictReader(source, delimiter=SEPARATOR, skipinitialspace=True)
        header = table.fieldnames = [name.strip() for name in table.fieldnames or ()]
        rows = list(table)
except (OSError, UnicodeDecodeError, csv.Error) as error:
    sys.exit(f"{sys.argv[1]} cannot be read as CSV: {error}")
if not rows:
    sys.exit(f"{sys.argv[1]} has no line of samples below its header")
needed = [name for name in (TIME, *GYRO, *ACCEL, *REFERENCE) if name]
if absent := [name for name in needed if name not in header]:
    sys.exit(f"{sys.argv[1]} has no column {', '.join(absent)}; it has {', '.join(header)}")
if not TIME and RATE_HZ <= 0.0:
    sys.exit("without a column of time the rate is needed: set RATE_HZ")

gyr, acc = GYRO_UNIT_RADPS * columns(GYRO) @ AXES.T, ACCEL_UNIT_MPS2 * columns(ACCEL) @ AXES.T
time_s = TIME_UNIT_S * columns((TIME,))[:, 0] if TIME else np.arange(len(rows)) / RATE_HZ
whole = np.isfinite(gyr).all(1) & np.isfinite(acc).all(1) & np.isfinite(time_s)
if not whole.any():
    sys.exit(f"{sys.argv[1]} has no line with a value in each column")
found = {"time_s": time_s[whole], "gyr": gyr[whole], "acc": acc[whole]}
if REFERENCE:
    found["ref_quat"] = columns(REFERENCE)[whole]
np.savez_compressed(sys.argv[2], **found)
print(f"{whole.sum()} samples, {(~whole).sum()} without a value left out")
