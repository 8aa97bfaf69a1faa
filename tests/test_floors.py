"""The floors of host/plumb: a module imports its own floor and those below it, and floors have no circles.

The order is that of the data: what is given, what every step has, the kernels, the link, the chip, the systems, the
boards, the proof, what feeds them, what learns from them, and what people call. An import inside a function counts like
one at the top of the file; one for types alone counts too. What judges a system is loaded by name, so it stands above
all that it uses.
"""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "host" / "plumb"
FLOORS = [
    "checkout", "version", "process_signals", "errors", "extras", "near_names", "files", "spec", "contract",
    "physics", "kernels", "tuning", "link", "flash", "f103", "systems", "boards", "proof", "readers", "audit",
    "writers", "bridge", "calibration", "analyses", "bench", "campaign", "api", "aio", "__init__", "cockpit", "cli",
    "pytest_plugin", "judging", "__main__",
]  # fmt: skip
"""From the ground up."""
LOADED = {
    "analyses/comparison/contenders": "judging",
    "analyses/estimation/estimated": "judging",
    "analyses/flights/estimators": "judging",
    "analyses/identification/tested_loop": "judging",
    "analyses/identification/vehicle_fit": "judging",
    "cli/demo": "judging",
    "cli/verbs": "judging",
    "contract/parameters": "systems",
    "contract/scenario": "systems",
    "contract/step": "systems",
    "proof/figures": "judging",
    "proof/invariants": "judging",
    "proof/loop_figures": "judging",
    "proof/measures": "judging",
    "proof/runs": "judging",
    "readers/replay": "judging",
}
"""Module -> the floor above its own whose modules it loads at run time, by the name of a system. It declares their
contract; the module above imports the contract's floor and not the other way round."""
CHIP = {"plumb.errors", "plumb.extras", "plumb.process_signals", "plumb.flash.image", "plumb.flash.rom_model"}
"""What the simulated chip may import apart from itself: image files, the ROM loader, errors."""


def modules() -> list[str]:
    return sorted(path.relative_to(PACKAGE).with_suffix("").as_posix() for path in PACKAGE.rglob("*.py"))


def floor_of(dotted: str) -> str:
    """`plumb.link.session` -> `link`; the package itself -> `__init__`."""
    parts = dotted.removesuffix(".__init__").split(".")
    return parts[1] if len(parts) > 1 else "__init__"


def dotted(module: str) -> str:
    """`link/session` -> `plumb.link.session`; `link/__init__` -> `plumb.link`."""
    return ".".join(["plumb", *(part for part in module.split("/") if part != "__init__")])


@cache
def names() -> frozenset[str]:
    return frozenset(dotted(module) for module in modules())


def imported_by(module: str) -> set[str]:
    """Dotted names of the modules of plumb that a module imports, not the names inside them."""
    found = set()
    for node in ast.walk(ast.parse((PACKAGE / f"{module}.py").read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert not node.level and node.module, f"{module} imports relatively: write the whole name"
            inside = {f"{node.module}.{alias.name}" for alias in node.names}
            found |= {name if name in names() else node.module for name in inside}
    return found & names() - {dotted(module)}


def test_the_picture_shows_these_floors() -> None:
    done = subprocess.run([sys.executable, "tools/gen_floors.py", "--check"], cwd=PACKAGE.parents[1], check=False)
    assert done.returncode == 0


def test_every_module_stands_on_a_floor() -> None:
    assert {module.split("/")[0] for module in modules()} == set(FLOORS)


@pytest.mark.parametrize("module", modules())
def test_no_module_imports_a_floor_above_its_own(module: str) -> None:
    own = FLOORS.index(floor_of(dotted(module)))
    above = {name for name in imported_by(module) if FLOORS.index(floor_of(name)) > own}
    assert not above, f"{module} imports {', '.join(sorted(above))}"


def loaded_by(module: str) -> set[str]:
    """Floors whose modules a module loads by name: parts of a system, and f-strings that begin with plumb.FLOOR."""
    found = set()
    for node in ast.walk(ast.parse((PACKAGE / f"{module}.py").read_text(encoding="utf-8"))):
        if not isinstance(node, ast.Call):
            continue
        name = ast.unparse(node.func)
        if name.startswith("Part["):
            places = [ast.literal_eval(keyword.value) for keyword in node.keywords if keyword.arg == "place"]
            found |= set(places or ["systems"])
        elif name.endswith("import_module") or name == "__import__":
            found |= set(re.findall(r"^f?['\"]plumb\.(\w+)", ast.unparse(node.args[0])))
    return found


def test_loads_of_a_floor_above_are_those_declared() -> None:
    above = {
        (module, floor)
        for module in modules()
        for floor in loaded_by(module)
        if FLOORS.index(floor) > FLOORS.index(floor_of(dotted(module)))
    }
    assert above == set(LOADED.items())


@pytest.mark.parametrize("module", [module for module in modules() if module.startswith("f103/")])
def test_the_chip_knows_nothing_of_the_product(module: str) -> None:
    foreign = {name for name in imported_by(module) if floor_of(name) != "f103"} - CHIP
    assert not foreign, f"{module} imports {', '.join(sorted(foreign))}"


def test_no_modules_import_each_other_in_a_circle() -> None:
    """Of every import, those inside functions and those for types alone as well."""
    graph = {dotted(module): imported_by(module) for module in modules()}
    try:
        order = list(TopologicalSorter(graph).static_order())
    except CycleError as error:
        raise AssertionError(" imports ".join(reversed(error.args[1]))) from error
    assert len(order) == len(modules())


OF_ONE_FIELD = re.compile(r"attitude|\bangle|tilt|gyro|accel|kalman|quadrotor|wheels|balancer|lsb|_deg|turn_q32")


@pytest.mark.parametrize("module", [module for module in modules() if module.startswith("contract/")])
def test_what_every_step_has_speaks_of_no_field(module: str) -> None:
    text = (PACKAGE / f"{module}.py").read_text(encoding="utf-8")
    assert OF_ONE_FIELD.findall(text) == []
