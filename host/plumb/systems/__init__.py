"""The systems: published designs, each with its plant, sensors, scenarios and tunings.

A system X is the folder systems/X, its step in C (firmware/systems/X.c, firmware/include/plumb/X.h) and what judges it
(plumb.judging). The contract of a module is a Protocol, given below in parentheses; `load` checks the module.

    system.toml   its declaration: record, parameters, raw channels, frames (plumb.spec.declarations)
    fixed.py      the step in integers, for bit-exact comparison with the C (plumb.contract.step.FixedStep)
    reference.py  the published equations in float64 (plumb.contract.step.ReferenceModel)
    tuning.py     the tuning of a run in engineering units; settings of kernels are in plumb.spec.tuning
    quantise.py   engineering units to parameters, and back (plumb.contract.parameters.Quantiser)
    scenarios.py  scenarios, tunings and the plant (plumb.contract.scenario.System)

optional:

    pins.py       the plant on the pins of the virtual board (contracts.Pins), unless samples only arrive as frames
    poses.py      how it is held to calibrate its sensors (contracts.Poses)
    fly.py        its vehicle as a person flies it in the browser (plumb.systems.steered.Steered)
    ride.py       the same of a vehicle that a person rides
    blackbox.py   its steps in the columns of blackbox viewers (plumb.systems.blackbox.Blackbox)
    mavlink.py    what a ground station shows of it (plumb.systems.mavlink.MavlinkVehicle)
    wiring.py     the wiring of the board, for the drawings (plumb.systems.wiring.WiringDrawings)
    plant.c       the plant once more in C, for campaigns, with its inputs in compiled_plant.py
                  (plumb.systems.compiled_plants.CompiledPlant); without it a campaign closes the loop in Python

Folders of systems on PLUMB_SYSTEM_PATH are modules of this package, too.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar, overload

from plumb.errors import UsageError
from plumb.spec import declarations, system_parts
from plumb.spec.system_parts import Part

if TYPE_CHECKING:
    from plumb.contract.scenario import System

__path__ += [str(place) for place in declarations.search_path()]
SYSTEMS = {name: declared.title for name, declared in declarations.systems().items()}
"""Name -> title of every declared system, in the order of their numbers."""
P = TypeVar("P")


@overload
def load(name: str) -> System: ...
@overload
def load(name: str, part: Part[P]) -> P: ...
def load(name: str, part: Part[P] | None = None) -> System | P:
    """A module of a system's folder: `scenarios`, or the given part. Raises UsageError for an unknown system, a missing
    part, and a module that does not fulfil its contract."""
    if part is not None:
        return system_parts.load(name, part)
    from plumb.contract.scenario import SCENARIOS

    return system_parts.load(name, SCENARIOS)


def with_part(part: str) -> tuple[str, ...]:
    """Systems with a module of that name, in either folder, in the order of their numbers."""
    return tuple(
        name
        for name, declared in declarations.systems().items()
        if any((folder / f"{part}.py").is_file() for folder in (declared.folder, declared.judging))
    )


def default_for(part: str) -> str:
    """The default system of a command: the one that declares itself the default for that part, or the only one that has
    the part. Raises UsageError if there is no such system, or a choice."""
    able = with_part(part)
    declared = [name for name in able if part in declarations.system(name).default_for] or able
    if not declared:
        raise UsageError(f"no system here has a {part}")
    if len(declared) > 1:
        raise UsageError(f"say which system, with --system: {', '.join(able)}")
    return declared[0]
