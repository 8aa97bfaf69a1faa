"""Contract of every step under proof, whatever it controls or estimates.

parameters.py     its parameters as integers, changes of them during a run, and the tuning that they are made of
step.py           the step in integers and in float64 (Protocols)
scenario.py       scenarios, tunings and the plant of its runs (Protocols)
disturbance.py    faults and pushes of a run, as text
run_fixed.py      a run of the integers, bit-exact: what a board is compared with
run_reference.py  a run of the source's equations in float64

Nothing here knows a quantity of any system: names, units and figures are those that it declares.
"""
