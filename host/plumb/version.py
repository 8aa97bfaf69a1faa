"""Version and commit of this package: from git in a checkout, from built.json in an installed package.

A tag vX.Y.Z is version X.Y.Z; N commits later the version is X.Y.(Z+1).devN+gHASH. Without a tag, or without git, it is
FALLBACK. Only the standard library is imported: the build of the wheel loads this file before anything is installed.
"""

from __future__ import annotations

import json
import re
import subprocess
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from plumb.checkout import CHECKOUT, IN_CHECKOUT, PACKAGE

FALLBACK = "0.1.0"
"""Version of the next release while no tag is on the way to this commit; that of the C library (plumb/version.h)."""
BUILT = "built.json"
"""Written into the wheel and the sdist, in the folder of this file: {"version", "git_hash", "git_dirty"}."""
HASH_DIGITS = 16
_TAGGED = re.compile(r"v(\d+)\.(\d+)\.(\d+)-(\d+)-g([0-9a-f]+)")


class Version(NamedTuple):
    """git_hash: first 16 digits of the commit, '' when not known; git_dirty: the tree differed from it."""

    version: str
    git_hash: str
    git_dirty: bool

    @property
    def commit(self) -> str:
        """The commit as people read it, with a + when the tree differed from it; '' when not known."""
        return self.git_hash + "+" * (self.git_dirty and bool(self.git_hash))


def from_git(root: Path) -> Version | None:
    """State of a checkout from git; None if `root` is no checkout, or there is no git."""
    if not (root / ".git").exists():
        return None
    commit = _git(root, "rev-parse", f"--short={HASH_DIGITS}", "HEAD")
    if not commit:
        return None
    dirty = bool(_git(root, "status", "--porcelain", "--untracked-files=no"))
    described = _git(root, "describe", "--tags", "--long", "--match", "v[0-9]*.[0-9]*.[0-9]*", "HEAD")
    return Version(version_of(described), commit, dirty)


def version_of(described: str) -> str:
    """The version that `git describe --long` stands for (v0.2.0-3-g1a2b3c4: 0.2.1.dev3+g1a2b3c4); FALLBACK for ''."""
    tagged = _TAGGED.fullmatch(described)
    if tagged is None:
        return FALLBACK
    major, minor, patch, commits, short_hash = tagged.groups()
    if commits == "0":
        return f"{major}.{minor}.{patch}"
    return f"{major}.{minor}.{int(patch) + 1}.dev{commits}+g{short_hash}"


def from_built(folder: Path) -> Version | None:
    """Version data that the build of the wheel or sdist wrote into the package's folder; None without a readable
    file."""
    try:
        built = json.loads((folder / BUILT).read_text(encoding="ascii"))
        return Version(str(built["version"]), str(built["git_hash"]), bool(built["git_dirty"]))
    except (OSError, ValueError, KeyError, TypeError):
        return None


@lru_cache(maxsize=1)
def installed() -> Version:
    """Version and commit of the package that runs."""
    return (from_git(CHECKOUT) if IN_CHECKOUT else None) or from_built(PACKAGE) or Version(FALLBACK, "", False)


def _git(root: Path, *arguments: str) -> str:
    try:
        done = subprocess.run(["git", "-C", str(root), *arguments], capture_output=True, text=True, check=False)
    except OSError:
        return ""
    return "" if done.returncode else done.stdout.strip()
