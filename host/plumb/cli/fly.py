"""Fly a system's simulated vehicle in the browser, by keyboard or gamepad.

    plumb fly                                   prints an address, and flies there; --open opens it in the browser
    plumb fly --system quadrotor --seed 7       other errors of the sensors, another wind
    plumb fly --out flights                     where the records of the flights go (default: flights)
    plumb fly --board virtual                   the flash image on the simulated chip flies, in steps of 5 ms

The firmware, as built for this machine, flies the simulated vehicle in real time. The sticks of the page become CRSF
bytes on the line of the board's radio receiver. A page that is closed, hidden or hangs is a receiver that is lost. The
simulated chip takes more of this machine: a flight that is slower than real time says so, on the page and at the end.
Every flight is recorded, and has a report; `plumb replay` gives the record back to the bit. Runs until Ctrl-C, or for
--seconds. A second address watches. Nothing is fetched from a network.
"""

from __future__ import annotations

import argparse

from plumb.cli import steering

PART = "fly"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    steering.add_arguments(parser, PART, does="flies", done="flown", trips="flights", seeded="sensors and wind")


def main(arguments: argparse.Namespace) -> int:
    return steering.steer(arguments, PART)
