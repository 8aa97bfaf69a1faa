"""One axis of a recording of real sensors, and the tuning made to fit it, as inputs of a run."""

from __future__ import annotations

import argparse

from plumb.inputs import recording
from plumb.proof.runs import RunInputs
from plumb.systems.quad import scenarios as quad
from plumb.tuning.quantise import ControlParams


def inputs_of(arguments: argparse.Namespace) -> tuple[RunInputs, ControlParams, dict[str, object]]:
    """What `plumb replay` runs: inputs, parameters, and the heading of the summary."""
    axis = recording.pick_axis(recording.load(arguments.file), arguments.axis, arguments.period_us)
    if arguments.seconds is not None:
        axis = axis.first(recording.steps_in(arguments.seconds, axis.period_us, len(axis.raw)))
    inputs, params = recording.run_inputs(axis, quad.TUNINGS["recording"])
    return inputs, params, {"scenario": f"{arguments.file.name} about {arguments.axis}", "tuning": "recording"}
