"""The floors of host/plumb: a module imports its own floor and those below it, and floors have no circles.

The order is that of the data: what is given, the kernels, the link, the chip, the systems, the boards, the proof, what
feeds them, what learns from them, and what people call. An import inside a function counts like one at the top of the
file; one for types alone counts too. What judges a system is loaded by name, so it stands above all that it uses.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "host" / "plumb"
FLOORS = [
    "checkout", "version", "__init__", "process_signals", "errors", "extras", "near_names", "files", "spec", "physics",
    "kernels", "tuning", "link", "flash", "f103", "systems", "boards", "proof", "inputs", "analyses", "bench", "api",
    "aio", "cockpit", "cli", "pytest_plugin", "judging", "__main__",
]  # fmt: skip
"""From the ground up."""
CHIP = {"plumb.errors", "plumb.extras", "plumb.process_signals", "plumb.flash.image", "plumb.flash.rom_model"}
"""What the simulated chip may import besides itself: image files, the ROM loader, errors."""


def modules() -> list[str]:
    return sorted(path.relative_to(PACKAGE).with_suffix("").as_posix() for path in PACKAGE.rglob("*.py"))


def floor_of(dotted: str) -> str:
    """`plumb.link.session` -> `link`; a name of the package itself, like `plumb.__version__`, -> `__init__`."""
    parts = dotted.removesuffix(".__version__").split(".")
    return parts[1] if len(parts) > 1 else "__init__"


def imported_by(module: str) -> set[str]:
    """Dotted names of plumb that a module imports: modules and packages, not the names inside them."""
    found = set()
    for node in ast.walk(ast.parse((PACKAGE / f"{module}.py").read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            assert not node.level, f"{module} imports relatively: write the whole name"
            found |= (
                {f"{node.module}.{alias.name}" for alias in node.names} if node.module == "plumb" else {node.module}
            )
    return {name for name in found if name == "plumb" or name.startswith("plumb.")}


def at_the_top(statements: list[ast.stmt]) -> Iterator[ast.Import | ast.ImportFrom]:
    """Imports of a module outside its functions and classes: those under `if TYPE_CHECKING`, too."""
    for node in statements:
        if isinstance(node, ast.Import | ast.ImportFrom):
            yield node
        elif isinstance(node, ast.If | ast.Try):
            yield from at_the_top([*node.body, *node.orelse])


def loaded_with(module: str) -> set[str]:
    """Modules that a module imports at its top, without `plumb.`: when it is loaded, or for types alone."""
    found = set()
    for node in at_the_top(ast.parse((PACKAGE / f"{module}.py").read_text(encoding="utf-8")).body):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        else:
            found |= {f"{node.module}.{alias.name}" for alias in node.names} | {str(node.module)}
    return {name.removeprefix("plumb.") for name in found if name.startswith("plumb.")} - {
        module.removesuffix("/__init__").replace("/", ".")
    }


def test_every_module_stands_on_a_floor() -> None:
    assert {module.split("/")[0] for module in modules()} == set(FLOORS)


@pytest.mark.parametrize("module", modules())
def test_no_module_imports_a_floor_above_its_own(module: str) -> None:
    if module == "__init__":
        return  # it alone names what stands on the floor of the API, and loads it when a name is used first
    own = FLOORS.index(floor_of("plumb." + module.replace("/", ".")))
    above = {name for name in imported_by(module) if FLOORS.index(floor_of(name)) > own}
    assert not above, f"{module} imports {', '.join(sorted(above))}"


@pytest.mark.parametrize("module", [module for module in modules() if module.startswith("f103/")])
def test_the_chip_knows_nothing_of_the_product(module: str) -> None:
    foreign = {name for name in imported_by(module) if floor_of(name) != "f103"} - CHIP
    assert not foreign, f"{module} imports {', '.join(sorted(foreign))}"


def test_no_modules_import_each_other_in_a_circle() -> None:
    """Of what is imported at the top of a module, for types alone as well: a Protocol says what a part needs of the
    whole that it is in."""
    names = {module.removesuffix("/__init__").replace("/", "."): module for module in modules()}
    graph = {name: loaded_with(module) & set(names) for name, module in names.items()}
    left = dict(graph)
    while free := [name for name, needs in left.items() if not needs & set(left)]:
        for name in free:
            del left[name]
    assert not left, f"in a circle, or above one: {', '.join(sorted(left))}"
