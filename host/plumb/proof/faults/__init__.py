"""Inject named faults into the flash image while it is armed and drives, and compare each reaction with a limit.

limits.toml     the only place where a limit is written, with its reason
fault.py        declaration of a fault: name, group, injection, where it must be reported, which limit
scene.py        the virtual board with its plant, armed and driving, and the host that armed it
outputs.py      when the output pins were unsafe
reports.py      reports that the board sent, by frame and signal
runner.py       restores the armed scene for every fault, injects, measures, and judges
table.py        all faults, one module for each group: sensors, buses, clock, power, memory, host, frames, hangs,
                flights, rides (with pilot.py, who flies and rides)
"""
