"""The flash images in the package: those that plumb.spec.images names.

`make wheel` writes images/ into the package (tools/package_images.py), with the manifest images.json:

    {"format": "plumb images 1", "images": [{"name", "file", "sha256", "bytes", "git_hash", "git_dirty", "systems",
    "golden": {"vectors", "steps"} or null}, ...]}

`golden` counts what `plumb golden check` compared on the virtual board with this image; null: it was not checked. A
checkout has no such folder until `make wheel` has run.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path

from plumb.checkout import PACKAGE
from plumb.errors import UsageError
from plumb.files.input_files import read_bytes

FORMAT = "plumb images 1"
FOLDER = PACKAGE / "images"
MANIFEST = "images.json"
MOST_BYTES = 1 << 20
_AGAIN = "install plumb again"


@dataclass(frozen=True)
class PackagedImage:
    """One row of the manifest. sha256: of the file, in lower-case hexadecimal digits; golden_steps: steps that agreed
    with the golden vectors when the package was made, None when they were not compared."""

    name: str
    path: Path
    sha256: str
    git_hash: str
    git_dirty: bool
    systems: tuple[str, ...]
    golden_steps: int | None

    def verify(self) -> None:
        """Raises UsageError unless the file is the one that the manifest lists."""
        if hashlib.sha256(read_bytes(self.path, MOST_BYTES, _AGAIN)).hexdigest() != self.sha256:
            raise UsageError(f"{self.path} is not the image that {MANIFEST} lists; {_AGAIN}")


def packaged_images(folder: Path = FOLDER) -> dict[str, PackagedImage]:
    """Name -> image, in the manifest's order; empty where the package carries none. Raises UsageError when the manifest
    is damaged."""
    path = folder / MANIFEST
    if not path.is_file():
        return {}
    data = read_bytes(path, MOST_BYTES, _AGAIN)
    try:
        whole = json.loads(data)
        if whole["format"] != FORMAT:
            raise ValueError
        rows = [_row(table, folder) for table in whole["images"]]
    except (ValueError, KeyError, TypeError, RecursionError):
        raise UsageError(f"{path} is damaged; {_AGAIN}") from None
    return {row.name: row for row in rows}


def _row(table: dict[str, object], folder: Path) -> PackagedImage:
    name, file, systems, golden = str(table["name"]), str(table["file"]), table["systems"], table["golden"]
    if Path(file).name != file or not isinstance(systems, list):
        raise ValueError
    steps = int(golden["steps"]) if isinstance(golden, dict) else None
    return PackagedImage(
        name, folder / file, str(table["sha256"]), str(table["git_hash"]), bool(table["git_dirty"]),
        tuple(map(str, systems)), steps,
    )  # fmt: skip


def packaged_image(name: str, folder: Path = FOLDER) -> Path | None:
    """The file of the image of that name, its SHA-256 checked; None where the package carries no such image."""
    found = packaged_images(folder).get(name)
    if found is None:
        return None
    found.verify()
    return found.path
