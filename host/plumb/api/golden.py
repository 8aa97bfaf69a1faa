"""`plumb.golden.check`: golden vectors on boards, with a result per vector."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from plumb.api import arguments
from plumb.boards import open_board
from plumb.boards.preconditions import require_boards
from plumb.errors import UsageError
from plumb.proof import golden
from plumb.proof.golden_result import VectorResult

__all__ = ["GoldenResult", "VectorResult", "check"]


@dataclass(frozen=True)
class GoldenResult:
    """Results of boards on golden vectors.

    Attributes:
        vectors: One entry per board and vector, in the order of the boards and of the recipe.
    """

    vectors: tuple[VectorResult, ...]

    @property
    def bit_exact(self) -> bool | None:
        """Whether all boards gave the digests of all vectors; False before None, where answers were lost."""
        answers = [one.bit_exact for one in self.vectors]
        return False if False in answers else None if None in answers or not answers else True

    @property
    def steps(self) -> int:
        """Steps of all vectors on all boards."""
        return sum(one.steps for one in self.vectors)

    def failed(self) -> tuple[VectorResult, ...]:
        """The entries that are not bit-exact."""
        return tuple(one for one in self.vectors if not one.bit_exact)


def check(
    boards: Sequence[str] = ("native",),
    systems: Sequence[str] | None = None,
    *,
    names: Sequence[str] | None = None,
    folder: Path | str | None = None,
    link: Literal["serial", "can"] = "serial",
    image: Path | str | None = None,
) -> GoldenResult:
    """Run golden vectors on boards and compare every step's digest: `plumb golden check`.

    Args:
        boards: Names of boards, as `plumb.run` takes them; `fixed` is the integer model in Python.
        systems: Only the vectors of these systems; None: of all.
        names: Only the vectors whose name fits one of these patterns (`*` and `?` as in file names); None: all.
        folder: Folder of the vectors; None: the checkout's, else the package's.
        link: Link to board `virtual`.
        image: Flash image of board `virtual`.

    Returns:
        A result per board and vector. A board behind a link takes the vectors that the recipe marks for it, other
        boards take all.

    Raises:
        UsageError: A name that does not exist, an image or a program that cannot be run, or vectors that are damaged
            or not those of their recipe; all of it before any vector runs.
        LinkError: A board does not answer.
    """
    arguments.require_names(boards=boards, systems=systems, names=names)
    if not boards:
        raise UsageError("boards = []: name at least one, such as native")
    arguments.require_link(link)
    flash_image = arguments.optional_path_of("image", image)
    require_boards(list(boards), flash_image)
    place = golden.vectors_folder(arguments.optional_path_of("folder", folder))
    cases = golden.cases(place, systems, names)
    found: list[VectorResult] = []
    for name in boards:
        with open_board(name, link=link, image=flash_image) as board:
            found += golden.check_each(board, name, cases)
    return GoldenResult(tuple(found))
