"""Pitch and roll of a recording, or of a file of datagrams, as inputs of a run."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from plumb.contract.parameters import ControlParams, quantise
from plumb.judging.phone.inputs import live_run, udp
from plumb.proof.runs import RunInputs
from plumb.proof.scenario_run import OWN
from plumb.readers import recording
from plumb.readers.replay import ReplayRequest
from plumb.systems.phone import scenarios as phone
from plumb.systems.phone.tuning import PhoneTuning


def inputs_of(request: ReplayRequest) -> tuple[RunInputs, ControlParams, dict[str, object]]:
    """The run of `plumb replay`: inputs, parameters, and the heading of the summary."""
    period_us = phone.PERIOD_US if request.period_us is None else request.period_us
    given = request.tuning or phone.TUNINGS[phone.DEFAULT_TUNING]
    assert isinstance(given, PhoneTuning)
    params = quantise(replace(given, period_us=period_us))
    steps, intake, recorded = udp.steps_of_file(request.file, period_us, request.decimate, request.loaded)
    longest = live_run.longest_run(steps)
    if request.seconds is not None:
        longest = longest[: recording.steps_in(request.seconds, period_us, len(longest))]
    heading: dict[str, object] = {
        "scenario": request.file.name,
        "tuning": OWN if request.tuning else phone.DEFAULT_TUNING,
        "received": intake.to_json(),
    }
    return live_run.inputs_of(longest, params, recorded), params, heading


def reads_itself(path: Path) -> bool:
    """Files of an app's datagrams."""
    return path.is_file() and not udp.is_recording(path)
