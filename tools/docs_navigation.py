"""A hook of the documentation site (mkdocs.yml): an entry of the navigation with a `*` stands for the pages it matches.

A page named after a system comes in the order of the systems' numbers, before the others, so that a new system's pages
appear without an entry of their own. A page that has an entry of its own is not listed again.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, MutableMapping
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "host"))

from plumb.spec import declarations  # noqa: E402


def named(nav: object) -> Iterator[str]:
    """Every page or pattern of a navigation, from the top down."""
    if isinstance(nav, str):
        yield nav
    elif isinstance(nav, dict):
        for value in nav.values():
            yield from named(value)
    elif isinstance(nav, list):
        for entry in nav:
            yield from named(entry)


def expanded(nav: object, docs: Path, taken: set[str]) -> object:
    """The navigation with every pattern replaced by its pages. taken: pages with an entry of their own."""
    if isinstance(nav, dict):
        return {title: expanded(value, docs, taken) for title, value in nav.items()}
    if not isinstance(nav, list):
        return nav
    entries: list[object] = []
    for entry in nav:
        if isinstance(entry, str) and "*" in entry:
            entries += [page for page in pages(entry, docs) if page not in taken]
        else:
            entries.append(expanded(entry, docs, taken))
    return entries


def pages(pattern: str, docs: Path) -> list[str]:
    systems = declarations.names()
    found = sorted(
        docs.glob(pattern), key=lambda path: (systems.index(path.stem) if path.stem in systems else 99, path)
    )
    return [path.relative_to(docs).as_posix() for path in found]


def on_config(config: MutableMapping[str, object]) -> MutableMapping[str, object]:
    """Called by mkdocs with the settings of the site."""
    config["nav"] = expanded(config["nav"], Path(str(config["docs_dir"])), set(named(config["nav"])))
    return config
