"""Draw the floors of host/plumb: docs/images/floors.svg, from the order in tests/test_floors.py and the first
sentence of each package.

usage: .venv/bin/python tools/gen_floors.py [--check]
"""

from __future__ import annotations

import ast
import html
import re
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
PACKAGE, ORDER, PICTURE = ROOT / "host/plumb", ROOT / "tests/test_floors.py", ROOT / "docs/images/floors.svg"
ROW, WIDTH, NAME = 26, 1240, 160
"""Height of a floor, width of the picture and of the column of names, px."""
STYLE = (
    "text{font:14px sans-serif;fill:#1f2430}.name{font:600 14px monospace}.loads{text-anchor:end}"
    "rect{fill:#e8ebf7;stroke:#fff;stroke-width:2}"
    "@media(prefers-color-scheme:dark){text{fill:#e6e6ee}rect{fill:#2b2f45;stroke:#15161f}}"
)


def declared(name: str) -> Any:
    """Value of a constant in tests/test_floors.py."""
    for node in ast.parse(ORDER.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Assign) and [ast.unparse(target) for target in node.targets] == [name]:
            return ast.literal_eval(node.value)
    raise SystemExit(f"{ORDER.name} declares no {name}")


def floors() -> list[str]:
    """From the ground up."""
    return [name for name in declared("FLOORS") if not name.startswith("__")]


def sentence(name: str) -> str:
    """The first sentence of a package's docstring."""
    path = PACKAGE / name / "__init__.py"
    source = path if path.is_file() else PACKAGE / f"{name}.py"
    text = " ".join((ast.get_docstring(ast.parse(source.read_text(encoding="utf-8"))) or "").split())
    return re.split(r"(?<=[a-z0-9)`])[.] ", text)[0].rstrip(".").replace("`", "")


def picture() -> str:
    rows, loads = [], {(module.split("/")[0], floor) for module, floor in declared("LOADED").items()}
    for at, name in enumerate(reversed(floors())):
        y = ROW * at
        rows.append(f'<rect x="0" y="{y}" width="{WIDTH}" height="{ROW}"/>')
        rows.append(f'<text class="name" x="10" y="{y + 18}">{name}</text>')
        rows.append(f'<text x="{NAME}" y="{y + 18}">{html.escape(sentence(name))}</text>')
        for floor in sorted(above for own, above in loads if own == name):
            rows.append(f'<text class="loads" x="{WIDTH - 10}" y="{y + 18}">loads {floor}/SYSTEM by name</text>')
    height = ROW * len(floors())
    title = "A module imports its own floor and those below it"
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" role="img" aria-label="{title}">\n'
        f"<title>{title}</title>\n<style>{STYLE}</style>\n" + "\n".join(rows) + "\n</svg>\n"
    )


def main() -> int:
    new, old = picture(), PICTURE.read_text(encoding="utf-8") if PICTURE.is_file() else ""
    if new != old and "--check" in sys.argv[1:]:
        print(f"{PICTURE.name} does not show the floors; run tools/gen_floors.py")
        return 1
    if new != old:
        PICTURE.write_text(new, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
