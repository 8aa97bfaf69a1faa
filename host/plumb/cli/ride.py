"""Ride a system's simulated vehicle in the browser, by keyboard or gamepad.

    plumb ride                                  prints an address, and rides there; --open opens it in the browser
    plumb ride --system wheels --seed 7         other errors of the sensors, another battery
    plumb ride --out rides                      where the records of the rides go (default: rides)
    plumb ride --board virtual                  the flash image on the simulated chip rides

The firmware, as built for this machine, balances and drives the simulated vehicle in real time. The sticks of the page
become CRSF bytes on the line of the board's radio receiver. A page that is closed, hidden or hangs is a receiver that
is lost: the vehicle stands. The simulated chip takes more of this machine: a ride that is slower than real time says
so, on the page and at the end. Every ride is recorded, and has a report; `plumb replay` gives the record back to the
bit. Runs until Ctrl-C, or for --seconds. A second address watches. Nothing is fetched from a network.
"""

from __future__ import annotations

import argparse

from plumb.cli import steering

PART = "ride"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    steering.add_arguments(parser, PART, does="rides", done="ridden", trips="rides", seeded="sensors and battery")


def main(arguments: argparse.Namespace) -> int:
    return steering.steer(arguments, PART)
