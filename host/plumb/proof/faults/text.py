"""Print the results of `plumb faults` as a table."""

from __future__ import annotations

from collections.abc import Sequence

from plumb.proof.faults.runner import Row

GREEN, RED, PLAIN = "\x1b[32m", "\x1b[31m", "\x1b[0m"
HEAD = ("fault", "link", "safe ms", "limit", "noticed ms", "reported")


def milliseconds(value: float | None) -> str:
    return "never" if value is None else f"{value:.1f}"


def render(rows: Sequence[Row], *, colour: bool = False) -> str:
    """A block for each system, a line for each fault, and a second line with the reasons of a fault that fails."""
    lines: list[str] = []
    for scene in dict.fromkeys(row.scene for row in rows):
        lines += [*([""] if lines else []), *_block(scene, [row for row in rows if row.scene == scene], colour)]
    failed = sum(row.verdict != "pass" for row in rows)
    lines += ["", f"{len(rows)} faults, {failed} failed: {'fail' if failed else 'pass'}"]
    return "\n".join(lines)


def _block(scene: str, rows: Sequence[Row], colour: bool) -> list[str]:
    width = max(len(HEAD[0]), *(len(row.name) for row in rows))
    lines = [scene, f"       {HEAD[0]:<{width}}  {HEAD[1]:<6} {HEAD[2]:>8} {HEAD[3]:>6} {HEAD[4]:>10}  {HEAD[5]}"]
    group = ""
    for row in rows:
        if row.group != group:
            group = row.group
            lines.append(f"  {group}")
        verdict = row.verdict if not colour else f"{GREEN if row.verdict == 'pass' else RED}{row.verdict}{PLAIN}"
        lines.append(
            f"  {verdict} {row.name:<{width}}  {row.link:<6} {milliseconds(row.safe_ms):>8} {row.limit_ms:>6g} "
            f"{milliseconds(row.detected_ms) if row.detected_ms is not None else '-':>10}  {row.reported}".rstrip()
        )
        if row.why:
            lines.append(f"         {row.what}: {row.why}")
    return lines
