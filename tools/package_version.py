"""Version of the distribution for scikit-build-core, as plumb.version reads it from git.

A wheel or sdist has no git; it contains host/plumb/built.json, which this module writes if git is available.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "host"))

from plumb.version import BUILT, FALLBACK, Version, from_built, from_git  # noqa: E402

PACKAGE = ROOT / "host" / "plumb"


def dynamic_metadata(field: str, settings: Mapping[str, Any]) -> str:
    """The version; raises RuntimeError for every other field."""
    if field != "version":
        raise RuntimeError(f"package_version gives the version alone, not {field}")
    return note_version(ROOT, PACKAGE).version


def note_version(root: Path, package: Path) -> Version:
    """Write the version from git into the package; without git, use the one written before, else the fallback."""
    found = from_git(root)
    if found is None:
        return from_built(package) or Version(FALLBACK, "", False)
    (package / BUILT).write_text(json.dumps(found._asdict()) + "\n", encoding="ascii")
    return found


if __name__ == "__main__":
    print(note_version(ROOT, PACKAGE).version)
