"""Samples of a live board: here a virtual board that another process serves, instead of serial:/dev/ttyUSB0."""

import re
import subprocess
import sys

import plumb

command = [sys.executable, "-m", "plumb", "virtual-board", "--serial", "tcp:0", "--system", "quad"]
with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
    try:
        assert process.stdout is not None
        port = re.search(r"socket://[\d.:]+", process.stdout.readline())
        assert port is not None
        with plumb.connect(f"serial:{port[0]}") as board:
            print(", ".join(board.identity.systems))
            samples = list(board.stream(seconds=0.5))
    finally:
        process.terminate()
last = samples[-1]
print(f"{len(samples)} samples, {last.time_s - samples[0].time_s:.2f} s, armed: {last.armed}, {last.health.mode}")
print(", ".join(sorted(last.signals)))

# Prints:
#     quad, balancer, turntable, phone, attitude
#     100 samples, 0.49 s, armed: False, REALTIME
#     bias_dps, command, pulse_0_us, pulse_1_us, rate_dps, tilt_deg, tilt_measured_deg
