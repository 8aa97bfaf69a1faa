"""Print the time constant of a share of `toy`, in s.

plumb toy-time 0.1
"""

from __future__ import annotations

import argparse


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("share", type=float, help="of a new count, above 0 and below 1")


def main(arguments: argparse.Namespace) -> int:
    import math

    from plumb.systems.toy.tuning import PERIOD_US

    print(f"{-PERIOD_US * 1e-6 / math.log(1.0 - arguments.share):.3f} s")
    return 0
