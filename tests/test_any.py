"""`Any` in host/plumb has its reason: a comment `# Any: ...` on the line, as for a library without types.

Where a contract belongs, a TypedDict, a dataclass, a Protocol or `object` with narrowing says more, and `mypy --strict`
holds the code to it.
"""

from __future__ import annotations

import io
import token
import tokenize
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[1] / "host" / "plumb"
LEFT = 18
"""Lines without a reason that are still there: lower it with every one that goes."""


def without_reason(source: str) -> list[int]:
    """Numbers of the lines whose code has the name Any and no reason; imports need none."""
    named, reasoned, importing = set(), set(), False
    for part in tokenize.generate_tokens(io.StringIO(source).readline):
        line = part.start[0]
        if part.type == token.NAME and part.string == "import":
            importing = True
        elif part.type == token.NEWLINE:
            importing = False
        elif part.type == token.NAME and part.string == "Any" and not importing:
            named.add(line)
        elif part.type == tokenize.COMMENT and "Any: " in part.string:
            reasoned.add(line)
    return sorted(named - reasoned)


def test_every_any_has_its_reason() -> None:
    bare = [
        f"{path.relative_to(PACKAGE).as_posix()}:{line}"
        for path in sorted(PACKAGE.rglob("*.py"))
        for line in without_reason(path.read_text(encoding="utf-8"))
    ]
    assert len(bare) <= LEFT, f"{len(bare)} lines, {LEFT} allowed; Any without a reason: {', '.join(bare)}"


def test_a_reason_stands_on_the_line_of_its_any() -> None:
    lines = (
        "from typing import Any",
        "x: Any = 1",
        "y: Any = 2  # Any: no types",
        "z = 'Any'",
        "# Any: up",
        "t: Any",
    )
    assert without_reason("\n".join(lines) + "\n") == [2, 6]
