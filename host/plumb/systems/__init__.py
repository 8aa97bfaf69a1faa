"""The systems: a published design each, with its plant, its sensors, its scenarios and its tunings.

A system X is the folder systems/X, besides its step in C (firmware/systems/X.c, firmware/include/plumb/X.h). What a
module of it must offer, and what is optional in it, its contract says: a Protocol, to which `load` holds the module.

    system.toml   its declaration: record, parameters, raw channels, frames (plumb.spec.declarations)
    fixed.py      the step in integers, for bit-exact comparison with the C (contracts.FixedStep)
    reference.py  the published equations in float64 (contracts.ReferenceModel)
    tuning.py     the tuning of a run in engineering units; settings of kernels are in plumb.spec.tuning
    quantise.py   engineering units to parameters, and back (plumb.tuning.quantise.Quantiser)
    scenarios.py  scenarios, tunings and the plant (contracts.System)
    plots.py      how a run is measured and drawn (plumb.proof.runs.RunPlots)

and where the system wants them

    pins.py       the plant on the pins of the virtual board (contracts.Pins); none where samples only come as frames
    figures.py    what was asked, and what is reached (plumb.proof.figures.FigureSections)
    wiring.py     what is wired to the board, for the drawings (plumb.systems.wiring.WiringDrawings)
    replay.py     recordings of real sensors as inputs of a run (plumb.inputs.replay.Replayed)
    compare.py    its vertical, for comparison with published algorithms (plumb.inputs.comparison.contenders.Compared)
    demo.py       the run that `plumb demo` shows (plumb.cli.demo.Demo)
    commands/     commands of its own, as system.toml declares them; modules like those of plumb.cli
    inputs/       where its samples come from besides boards and recordings

Folders of systems on PLUMB_SYSTEM_PATH are modules of this package, too.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar, overload

from plumb.errors import UsageError
from plumb.spec import declarations, system_parts
from plumb.spec.system_parts import Part

if TYPE_CHECKING:
    from plumb.systems.contracts import System

__path__ += [str(place) for place in declarations.search_path()]
SYSTEMS = {name: declared.title for name, declared in declarations.systems().items()}
"""Name -> title of each system that is declared, in the order of their numbers."""
P = TypeVar("P")


@overload
def load(name: str) -> System: ...
@overload
def load(name: str, part: Part[P]) -> P: ...
def load(name: str, part: Part[P] | None = None) -> System | P:
    """A module of a system's folder, its scenarios unless another part is asked for; raises UsageError for a system
    that does not exist, a part that it leaves out, and a module that does not offer what its contract says."""
    if part is not None:
        return system_parts.load(name, part)
    from plumb.systems.contracts import SCENARIOS

    return system_parts.load(name, SCENARIOS)


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
