"""Judging, showing and feeding a system: one folder a system, loaded by name, that nothing below imports.

The step of a system X, its plant and its scenarios are in systems/X. The contract of a module here is a Protocol, given
below in parentheses; `plumb.systems.load` checks the module against it.

    plots.py      metrics and plots of a run (plumb.proof.runs.RunPlots)

optional:

    figures.py    targets and reached figures (plumb.proof.figures.FigureSections)
    invariants.py what holds in every run of its scenario `random` (plumb.proof.invariants.Invariants)
    limits.toml   how far the estimate of a run may be from the truth (tools/gen_limits.py)
    margins.toml  margins of its closed loops on the flash image (tools/gen_margins.py)
    sweep.py      how they are swept on a board (plumb.proof.loop_figures.SweptLoops)
    tested_loops.py  loops that `plumb tune pid` tests (plumb.analyses.identification.tested_loop.TestedLoops)
    flown_vehicle.py  the vehicle in a flight, for `plumb tune vehicle`
                  (plumb.analyses.identification.vehicle_fit.FlownVehicles)
    replay.py     recordings of real sensors as inputs of a run (plumb.readers.replay.Replayed)
    compare.py    its vertical, for comparison with published algorithms (plumb.analyses.comparison.contenders.Compared)
    flight.py     its vertical in simulated flight (plumb.analyses.flights.estimators.FlownSystem)
    demo.py       the run that `plumb demo` shows (plumb.cli.demo.Demo)
    commands/     the system's own commands, as system.toml declares them; modules like those of plumb.cli
    inputs/       further sources of samples

A folder D on PLUMB_SYSTEM_PATH holds the step of a system X in D/X, and these modules in D/judging/X.
"""

from plumb.spec import declarations
from plumb.spec.system import JUDGING

__path__ += [str(place / JUDGING.name) for place in declarations.search_path()]
