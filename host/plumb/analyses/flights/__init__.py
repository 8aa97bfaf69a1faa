"""Closed-loop flights of a simulated quadrotor, flown on each estimator's vertical: `plumb compare --flights`.

flights.py      the flights by name: pilot, wind, sensors, airframe
pilots.py       what the pilot asks for
cascade.py      the float controller: attitude, rates, mixer
estimators.py   estimators for many runs side by side
fly.py          the loop, a step of all runs at a time
inputs.py       flights as rows of the comparison
"""
