"""The systems: a published design each, with its plant, its sensors, its scenarios and its tunings.

A system X is the folder systems/X, besides its step in C (firmware/systems/X.[ch]):

    systems/X/system.toml   its declaration: record, parameters, raw channels, frames (see plumb.spec.declarations)
    systems/X/fixed.py      the step in integers, for bit-exact comparison with the C
    systems/X/reference.py  the published equations in float64
    systems/X/tuning.py     the tuning of a run in engineering units; settings of kernels are in plumb.spec.tuning
    systems/X/quantise.py   engineering units to parameters, and back
    systems/X/scenarios.py  scenarios and tunings
        SCENARIOS               name -> one sentence;  SECONDS  name -> how long
        TUNINGS                 name -> tuning;  TUNING_NOTES  name -> one sentence
        DEFAULT_SCENARIO, DEFAULT_TUNING, PERIOD_US, LINK (words of the link's part of the parameters, by name)
        STARTS                  start-up mode -> Start, for the tunings that it suits;  START_NOTES
        CONDITIONS              what of a scenario can be set besides, name -> one sentence: a number, for scenario()
        FAULTS                  kind -> one sentence;  FAULT_CHANNELS  of what, by name
        faults(requests)        what scenario(faults=...) takes
        OUTPUT_FRAMES           word of the record -> (frame, signal) that carries it over a link: what moves the plant
        OUTPUTS                 those words; none where nothing is driven, and every loop is open
        scenario(name, seed, *, seconds=None, period_us=..., faults=())    everything random of one run, drawn; it has
            period_us, steps, time_s (steps,), scored (steps,) bool: the samples that count
            fit(tuning)             optional: the tuning of this very run, where it depends on what was drawn
            counts() (steps, 6) int16, setpoint() (steps,) int32, truth() name -> (steps,): of the prescribed motion
        plant(scenario, open_loop=False)    the physics, and sensors that ride on it; it has
            follow(time_s, outputs)         simulate up to time_s with the words of the last step ({}: none yet)
            counts(time_s) six raw counts, truth(time_s) name -> number, setpoint(time_s) int
    systems/X/plots.py      how a run is measured and drawn: metrics(run), plots(run, closed=...)
    systems/X/figures.py    what was asked, and what is reached: SECTIONS, ASSUMED (see plumb.proof.figures)
    systems/X/pins.py       on the pins of the virtual board: Coupling(machine, plant), FRAMES, ... (see
                            plumb.boards.plant_on_pins); none where samples only ever come as frames
    systems/X/replay.py     optional: recordings of real sensors as inputs of a run (see plumb.cli.replay)
    systems/X/demo.py       optional: the run that `plumb demo` shows (see plumb.cli.demo)
    systems/X/commands/     optional: commands of its own, as system.toml declares them; modules like those of plumb.cli
    systems/X/inputs/       optional: where its samples come from besides boards and recordings

Folders of systems on PLUMB_SYSTEM_PATH are modules of this package, too.
"""

from __future__ import annotations

import importlib
from types import ModuleType
from typing import Any

from plumb.errors import UsageError
from plumb.spec import declarations

__path__ += [str(place) for place in declarations.search_path()]
SYSTEMS = {name: declared.title for name, declared in declarations.systems().items()}
"""Name -> title of each system that is declared, in the order of their numbers."""


def load(name: str, part: str = "scenarios") -> ModuleType:
    """A module of a system's folder, named as in the list above; raises UsageError for a system that does not exist,
    and for `pins` of a system whose samples always arrive as frames."""
    declared = declarations.system(name)
    module = f"plumb.systems.{name}.{part}"
    if part == "pins" and not (declared.folder / "pins.py").is_file():
        raise UsageError(f"the board has no sensors of its own for {name}: its samples come as frames")
    return importlib.import_module(module)


def with_part(part: str) -> tuple[str, ...]:
    """The systems whose folders have that module, in the order of their numbers."""
    return tuple(
        name for name, declared in declarations.systems().items() if (declared.folder / f"{part}.py").is_file()
    )


def default_for(part: str) -> str:
    """The system whose module of that name a command takes unless told otherwise: the one that declares it, or the only
    one that has it. Raises UsageError where that leaves a choice, or none."""
    able = with_part(part)
    declared = [name for name in able if part in declarations.system(name).default_for] or able
    if not declared:
        raise UsageError(f"no system here has a {part}")
    if len(declared) > 1:
        raise UsageError(f"say which system, with --system: {', '.join(able)}")
    return declared[0]


def fitted(scenario: Any, tuning: Any) -> Any:
    """The tuning for a scenario's run."""
    return scenario.fit(tuning) if hasattr(scenario, "fit") else tuning
