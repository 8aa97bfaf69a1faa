"""Which motor is which on a quadrotor, PROPELLERS OFF: each one in turn is the fastest for two seconds.

BOARD=serial:/dev/ttyUSB0 python examples/python/rotor_order.py     without BOARD: one in this process
"""

import os

import plumb

CORNERS = {"front right": (-0.5, -0.5), "front left": (0.5, -0.5), "rear left": (0.5, 0.5), "rear right": (-0.5, 0.5)}
"""Rotor -> sticks of roll and pitch that lower the corner opposite to it."""
THROTTLE, ROTORS_ON, READY_S, TURN_S = 0.2, 1, 3.0, 2.0

name = os.environ.get("BOARD", "native")
with plumb.connect(name, system="quadrotor" if name == "native" else None) as board:
    if board.params["receiver"]:
        raise SystemExit("a pilot has the sticks: set receiver=0 first, with plumb params set")
    list(board.stream(seconds=READY_S))  # at rest and level, it is ready then
    try:
        board.arm()
    except plumb.PlumbError as refused:
        raise SystemExit(f"not armed: {refused}") from None
    for corner, (roll, pitch) in CORNERS.items():
        board.set_setpoint(THROTTLE)
        board.set_commands({"roll": roll, "pitch": pitch, "switches": ROTORS_ON})
        last = list(board.stream(seconds=TURN_S))[-1]
        pulses = [round(last.signals[f"pulse_{rotor}_us"], -1) for rotor in range(4)]
        print(f"{corner}: {', '.join(f'{pulse:.0f}' for pulse in pulses)} us")
    board.disarm()

# Prints:
#     front right: 1350, 1200, 1050, 1200 us
#     front left: 1200, 1350, 1200, 1050 us
#     rear left: 1050, 1200, 1350, 1200 us
#     rear right: 1200, 1050, 1200, 1350 us
