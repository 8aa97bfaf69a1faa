"""Record the simulated board to a log, load the log as arrays in units, and reproduce it bit for bit."""

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

import plumb

with tempfile.TemporaryDirectory() as folder:
    path = Path(folder) / "today.plog"
    record = [sys.executable, "-m", "plumb", "record", "--board", "virtual", "--run", "live", "--seconds", "1"]
    subprocess.run([*record, "--out", str(path)], check=True, capture_output=True)

    run = plumb.load(path)  # or a .blf, .asc, .trc or candump .log with raw counts
    assert isinstance(run, plumb.LoggedRun)
    result = run.replay(board="native")

period_ms = 1e3 * (run.time_s[1] - run.time_s[0])
print(f"{run.system}, a step every {period_ms:g} ms, kp {run.parameters['pid.kp_per_deg']:g} per deg")
print(f"tilt up to {np.nanmax(np.abs(run.signals['tilt_deg'])):.1f} {run.units['tilt_deg']}")
print(f"every digest reproduced: {result.bit_exact}")

# Prints:
#     quad, a step every 5 ms, kp 0.0216 per deg
#     tilt up to 0.9 deg
#     every digest reproduced: True
