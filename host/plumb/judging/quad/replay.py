"""One axis of a recording of real sensors, and the tuning made to fit it, as inputs of a run."""

from __future__ import annotations

from plumb.contract.parameters import ControlParams
from plumb.proof.runs import RunInputs
from plumb.proof.scenario_run import OWN
from plumb.readers import recording
from plumb.readers.replay import ReplayRequest
from plumb.systems.quad import scenarios as quad
from plumb.systems.quad.tuning import QuadTuning

VERTICAL_Z = (
    "--axis z: gravity does not turn about an upright z axis, so the accelerometer cannot measure that angle; the tilt"
    " about z is defined only while z lies near the horizontal"
)


def inputs_of(request: ReplayRequest) -> tuple[RunInputs, ControlParams, dict[str, object]]:
    """Inputs, parameters, and the first entries of the summary of `plumb replay`."""
    axis = recording.pick_axis(request.recording(), request.axis, request.period_us)
    if request.seconds is not None:
        axis = axis.first(recording.steps_in(request.seconds, axis.period_us, len(axis.raw)))
    tuning = request.tuning or quad.TUNINGS["recording"]
    assert isinstance(tuning, QuadTuning)
    inputs, params = recording.run_inputs(axis, tuning)
    name = OWN if request.tuning else "recording"
    heading: dict[str, object] = {"scenario": f"{request.file.name} about {request.axis}", "tuning": name}
    if request.axis == "z":
        heading["warnings"] = [VERTICAL_Z]
    return inputs, params, heading
