"""The paper's rule for the accelerometer of `quad`: from the bandwidth of the motion to its low-pass and its noise.

    plumb bandwidth 2.5                 a low-pass slightly above it, the noise behind it, the delay it costs
    plumb bandwidth --table             5, 20, 50 and 350 Hz on the scenario `motion`, over seeds 1000 to 1039

Less bandwidth is less noise and more delay; the table has both, and what is left of them behind the Kalman filter.
"""

from __future__ import annotations

import argparse
import json

from plumb.cli import options
from plumb.cli.whole_numbers import whole_number


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("motion_hz", nargs="?", type=float, metavar="HZ", help="the highest frequency of the motion")
    parser.add_argument("--resistor", type=float, default=10_000.0, metavar="OHM", help="of the filter (default 10000)")
    parser.add_argument("--table", action="store_true", help="run the scenario behind 5, 20, 50 and 350 Hz")
    parser.add_argument("--seeds", type=whole_number, default=40, help="of the table, from 1000 on (default 40)")
    options.add_json(parser)


def main(arguments: argparse.Namespace) -> int:
    from plumb.errors import UsageError
    from plumb.judging.quad import bandwidth

    if arguments.motion_hz is None and not arguments.table:
        raise UsageError("say how fast the motion is, as plumb bandwidth HZ, or ask for the --table")
    choice = None if arguments.motion_hz is None else bandwidth.choose(arguments.motion_hz, arguments.resistor)
    rows = table(arguments.seeds) if arguments.table else []
    if arguments.json:
        print(json.dumps({"choice": choice and choice.to_json(), "table": rows}))
        return 0
    if choice:
        print(bandwidth.describe(choice))
    if rows:
        print(f"{'low-pass':>10} {'noise':>9} {'delay':>9} {'accelerometer':>16} {'trapezium':>12} {'worst':>9}")
    for row in rows:
        print(
            f"{row['corner_hz']:>7g} Hz {row['noise_mg']:>6.2f} mg {row['delay_ms']:>6.2f} ms"
            f" {row['accel_only_rmse_deg']:>8.3f} deg rms {row['angle_rmse_deg']:>8.3f} deg"
            f" {row['worst_deg']:>5.3f} deg"
        )
    return 0


def table(count: int) -> list[dict[str, float]]:
    """`motion` behind each low-pass, the C integers: rms errors in deg, mean of the seeds and worst seed."""
    from plumb.errors import UsageError
    from plumb.judging.quad import bandwidth
    from plumb.judging.quad import figures as quad_figures
    from plumb.systems.quad import scenarios as quad

    if not 1 <= count <= 1000:
        raise UsageError("the table takes 1 to 1000 seeds")
    rows = []
    for corner_hz, figure in zip(
        quad.BANDWIDTHS_HZ, quad_figures.bandwidth_rows(range(1000, 1000 + count)), strict=True
    ):
        behind = bandwidth.behind(corner_hz, corner_hz)
        assert figure.accel_only is not None and figure.worst is not None
        rows.append(
            {
                "corner_hz": corner_hz,
                "noise_mg": behind.noise_mg,
                "delay_ms": behind.delay_ms,
                "accel_only_rmse_deg": figure.accel_only,
                "angle_rmse_deg": figure.reached,
                "worst_deg": figure.worst,
            }
        )
    return rows
