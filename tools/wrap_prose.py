"""Break the prose of Markdown files at 120 columns.

usage: .venv/bin/python tools/wrap_prose.py [--check] [FILE.md ...]

Without files: every Markdown file of the checkout. Only a paragraph or list item with a line that is too long is laid
out anew. Code, tables, headings, HTML and front matter stay as they are, and no line breaks inside `code` or a link's
address. --check writes nothing, names each line that is too long and exits with 1.
"""

from __future__ import annotations

import argparse
import itertools
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
COLUMNS = 120
ITEM = re.compile(r"(\s*)((?:[-*+]|\d+\.)\s+)\S")
FENCE = re.compile(r"\s*(```|~~~)")
NO_PROSE = re.compile(r"\s*(#|\||<(?!a )|>|!!!|---$|\[\^?[^\]]+\]:)")
"""Headings, tables, HTML but an anchor in a line, quotations, admonitions, rules, definitions of links."""
ATOM = re.compile(r"(?:`[^`]*`|!\[[^\]]*\]\([^)]*\)|\]\([^)]*\)|\S)+")
"""A word; code, a picture and the address of a link have no place to break at."""
MARKUP = re.compile(r"(?:[-*+>|#=]|\d+[.)])")
"""A word that would begin a list, a quotation, a table or a heading if it began a line."""

Block = tuple[list[str], bool]
"""Lines, and whether they are prose."""


def blocks(lines: list[str]) -> Iterator[Block]:
    """Paragraphs and list items, each by itself; all other lines one by one."""
    fence = ""
    front_matter = bool(lines) and lines[0] == "---"
    prose: list[str] = []
    inside = [0]  # the columns at which text of the enclosing list items begins
    after_blank = True
    for at, line in enumerate(lines):
        begun = FENCE.match(line)
        indent = len(line) - len(line.lstrip())
        item = ITEM.match(line)
        if front_matter or fence or begun or not line.strip() or NO_PROSE.match(line):
            if prose:
                yield prose, True
                prose = []
            if begun and not fence:
                fence = begun[1]
            elif begun and fence == begun[1]:
                fence = ""
            front_matter = front_matter and not (at > 0 and line == "---")
            while line.strip() and len(inside) > 1 and indent < inside[-1]:
                inside.pop()  # a comment or a heading at the margin ends a list
            after_blank = not line.strip()
            yield [line], False
            continue
        if after_blank or item:
            while len(inside) > 1 and indent < inside[-1]:
                inside.pop()
        if after_blank and indent >= inside[-1] + 4:
            yield [line], False  # indented code, until the next line of prose
            continue
        if item and not (prose and indent >= inside[-1] + 4):
            if prose:
                yield prose, True
            prose = [line]
            inside.append(item.end() - 1)
        else:
            prose.append(line)
        after_blank = False
    if prose:
        yield prose, True


def laid_out(prose: list[str]) -> list[str]:
    """The lines of one paragraph or list item, at most COLUMNS wide where a word allows it."""
    item = ITEM.match(prose[0])
    first = prose[0][: item.end() - 1] if item else prose[0][: len(prose[0]) - len(prose[0].lstrip())]
    later = " " * len(first)
    words = ATOM.findall(" ".join([prose[0][len(first) :], *(line.strip() for line in prose[1:])]))
    found, line = [], first + words[0]
    for word, after in itertools.pairwise([*words[1:], ""]):
        last_of_line = MARKUP.fullmatch(after) and len(f"{line} {word} {after}") > COLUMNS
        if (len(f"{line} {word}") <= COLUMNS and not last_of_line) or MARKUP.fullmatch(word):
            line = f"{line} {word}"
        else:
            found.append(line)
            line = later + word
    return [*found, line]


def breakable(prose: list[str]) -> bool:
    """Whether a line is too long and none ends in a hard break."""
    return max(map(len, prose)) > COLUMNS and not any(line.endswith(("  ", "\\")) for line in prose)


def wrapped(text: str) -> str:
    """The same Markdown with lines of prose of at most COLUMNS."""
    found: list[str] = []
    for lines, prose in blocks(text.split("\n")):
        found += laid_out(lines) if prose and breakable(lines) else lines
    return "\n".join(found)


def too_long(text: str) -> list[int]:
    """Numbers of the lines of prose that could be broken and are longer than COLUMNS."""
    found, number = [], 1
    for lines, prose in blocks(text.split("\n")):
        if prose and breakable(lines) and laid_out(lines) != lines:
            found += [number + at for at, line in enumerate(lines) if len(line) > COLUMNS]
        number += len(lines)
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true")
    parser.add_argument("files", nargs="*", type=Path)
    asked = parser.parse_args()
    listed = subprocess.run(["git", "ls-files", "*.md"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    missed = 0
    for path in asked.files or [ROOT / name for name in listed.split()]:
        text = path.read_text(encoding="utf-8")
        if asked.check:
            for number in too_long(text):
                print(f"{path}:{number}: prose of more than {COLUMNS} columns; `make format` breaks it")
                missed = 1
        elif wrapped(text) != text:
            path.write_text(wrapped(text), encoding="utf-8")
    return missed


if __name__ == "__main__":
    sys.exit(main())
