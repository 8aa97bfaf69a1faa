"""The display of `plumb monitor` on a terminal: every signal with its extremes and its recent course, the state of the
board, counters, and the keys."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from plumb.cli.keyboard import ESCAPE, Keyboard
from plumb.cli.monitor_line import angles_deg, armed, count, mode, name_and_unit
from plumb.link.identity import PINS
from plumb.link.monitor import EVERY_S, QUATERNION, columns

if TYPE_CHECKING:
    from plumb.link.identity import Identity
    from plumb.link.monitor import Extremes, Snapshot

WINDOWS_S = (10, 30, 60, 120)
"""Lengths of the course that + and - choose from."""
NOT_SHOWN = {*QUATERNION, "flags"}
"""Columns without a row: a quaternion is shown as yaw, pitch and roll; what flags say, the lines below say."""
COUNTERS = (
    "saturated_steps", "starved_steps", "can_off_bus", "can_transmit_errors", "can_receive_errors", "can_bus_offs",
    "host_lost_steps", "host_lost", "host_rejected", "board_lost", "board_rejected", "board_dropped",
)  # fmt: skip
"""What four rows show; one row while all of them are 0."""
EULER = ("yaw_deg", "pitch_deg", "attitude_roll_deg")
"""Rows of an attitude, which stand first."""
BLOCKS, ASCII_BLOCKS = "▁▂▃▄▅▆▇█", "_.-=+*%@"
NARROWEST_COURSE, WIDEST_COURSE = 10, 100
ROW_WIDTH = 58
"""Columns of the terminal that a row needs in addition to the course."""
KEYS = "q quit   space freeze   r reset min and max   + - time span"


def sparkline(
    values: list[tuple[float, float]], end_s: float, window_s: float, cells: int, blocks: str = BLOCKS
) -> str:
    """The course of (time, value) over the window that ends at end_s, one character for each of `cells` equal spans:
    their mean, between the smallest and the largest of them. A span without a value is a space.

    The spans lie at whole multiples of their length, so that the course moves on without changing its shape."""
    span_s = window_s / cells
    newest = int(end_s / span_s)
    sums: dict[int, tuple[float, int]] = {}
    for time_s, value in values:
        cell = int(time_s / span_s) - newest + cells - 1
        if 0 <= cell < cells:
            total, number = sums.get(cell, (0.0, 0))
            sums[cell] = total + value, number + 1
    means = {cell: total / number for cell, (total, number) in sums.items()}
    if not means:
        return " " * cells
    low, high = min(means.values()), max(means.values())
    scale = (len(blocks) - 1) / (high - low) if high > low else 0.0
    return "".join(blocks[round((means[cell] - low) * scale)] if cell in means else " " for cell in range(cells))


class Screen:
    """The display. Use as a context manager; `show` draws a look, `ended` says whether the user has pressed q."""

    def __init__(self, console: Console | None = None) -> None:
        self.console = console or Console(highlight=False)
        self.window_s = WINDOWS_S[1]
        self._keyboard = Keyboard()
        self._live = Live(console=self.console, screen=True, auto_refresh=False, vertical_overflow="crop")
        self._identity: Identity | None = None
        self._course: dict[str, deque[tuple[float, float]]] = {}
        self._motors: set[str] = set()
        self._looks = 0
        self._ended = self._frozen = self._forget = False
        self._drawn: RenderableType | None = None

    def __enter__(self) -> Screen:
        self._keyboard.__enter__()
        self._live.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        """Leave the display, with its last picture on the ordinary screen."""
        self._live.__exit__(None, None, None)
        self._keyboard.__exit__()
        if self._drawn is not None:
            self.console.print(self._drawn)

    def begin(self, identity: Identity) -> None:
        self._identity = identity

    def ended(self) -> bool:
        """Act on the keys pressed since the last call; True once one of them ends the command."""
        for key in self._keyboard.pressed():
            self._press(key)
        return self._ended

    def _press(self, key: str) -> None:
        at = WINDOWS_S.index(self.window_s)
        if key in ("q", "Q", ESCAPE):
            self._ended = True
        elif key == " ":
            self._frozen = not self._frozen
        elif key == "r":
            self._forget = True
        elif key in ("+", "="):
            self.window_s = WINDOWS_S[min(at + 1, len(WINDOWS_S) - 1)]
        elif key == "-":
            self.window_s = WINDOWS_S[max(at - 1, 0)]

    def trouble(self, text: str) -> None:
        """Show why there are no new values, over the last ones."""
        said = Text(text, style="bold red")
        self._live.update(said if self._drawn is None else Group(said, self._drawn), refresh=True)

    def show(self, snapshot: Snapshot, extremes: Extremes, speed: float | None = None) -> None:
        """Draw one look. speed: simulated seconds per second of a simulated board, None of a real one."""
        if self._forget:
            extremes.forget()
            self._forget = False
        values = self._note(snapshot, extremes)
        if self._frozen and self._drawn is not None:
            self._live.update(Group(self._drawn, Text("frozen: space goes on", style="bold yellow")), refresh=True)
            return
        rows = self._signals(values, extremes)
        self._drawn = Group(self._head(snapshot, speed), rows, *self._state(snapshot), Text(KEYS, style="dim"))
        self._live.update(self._drawn, refresh=True)

    def _note(self, s: Snapshot, extremes: Extremes) -> dict[str, float | None]:
        """The values of the rows of a look, added to their course."""
        values: dict[str, float | None] = {
            name: s[name] for name in s if name in columns() and name not in {*NOT_SHOWN, *s["choices"]}
        }
        if s["attitude"]:
            values.update(zip(EULER, angles_deg(s["attitude"]), strict=True))
            for name in EULER:
                extremes.note(name, values[name] or 0.0)
        self._looks += 1
        self._motors |= set(s["motors"])
        for name, value in values.items():
            if value is not None:
                course = self._course.setdefault(name, deque(maxlen=round(WINDOWS_S[-1] / EVERY_S)))
                course.append((self._looks * EVERY_S, value))
        return values

    def _head(self, s: Snapshot, speed: float | None) -> Text:
        identity = self._identity
        head = Text()
        if identity is not None:
            pins = PINS.get(identity["PINS"], "?")
            head.append(f"board {identity.unique_id}, {identity.image_text}, pins {pins}\n")
            if identity.mismatch:
                head.append(f"{identity.mismatch}\n", style="red")
        rate = "-" if s["steps_per_s"] is None else f"{s['steps_per_s']:.1f}/s"
        head.append(f"{s['time_s']:.2f} s   {mode(s)}   ", style="bold")
        head.append(f" {armed(s)} ", style="bold white on red" if s["armed"] else "bold green")
        head.append(f"   step {count(s['step'])}, {rate}")
        if speed is not None and speed < 0.95:
            head.append(f"   simulated at {100 * speed:.0f} % of real time", style="yellow")
        if s["mode"] == "IDLE":
            head.append("\nno run is on: --run live begins one", style="yellow")
        return head

    def _signals(self, values: dict[str, float | None], extremes: Extremes) -> Table:
        ascii_only = self.console.options.ascii_only
        cells = min(max(self.console.width - ROW_WIDTH, NARROWEST_COURSE), WIDEST_COURSE)
        table = Table(box=None, padding=(0, 1), header_style="dim")
        for title in ("", "now", "", "min", "max"):
            table.add_column(title, justify="left" if title == "" else "right", no_wrap=True)
        table.add_column(f"last {self.window_s} s", no_wrap=True)
        for column in (*EULER, *(name for name in values if name not in EULER)):
            if column not in self._course:
                continue
            name, unit = name_and_unit(column.removeprefix("attitude_"))
            name = f"motor {name}" if column in self._motors else name
            value = values.get(column)
            course = sparkline(
                list(self._course[column]),
                self._looks * EVERY_S,
                self.window_s,
                cells,
                ASCII_BLOCKS if ascii_only else BLOCKS,
            )
            table.add_row(
                Text(name),
                Text("-" if value is None else f"{value:+z.3f}", style="dim" if value is None else "bold"),
                Text(unit, style="dim"),
                *(
                    Text(f"{bound[column]:+z.3f}" if column in bound else "-")
                    for bound in (extremes.low, extremes.high)
                ),
                Text(course, style="cyan"),
            )
        return table

    def _state(self, s: Snapshot) -> list[RenderableType]:
        """Reasons that block arming, faults, events and counters; those that need attention are coloured."""
        blocked = "; ".join(s["blocked"])
        faults = "; ".join(s["faults"])
        cause = "; ".join(s["disarm_cause"])
        errors = f"errors sent {count(s['can_transmit_errors'])}, received {count(s['can_receive_errors'])}"
        bus, off = ("off the bus", "red") if s["can_off_bus"] else ("on the bus", "")
        here = f"steps {s['host_lost_steps']}, other frames {s['host_lost']}, rejected {s['host_rejected']}"
        there = (
            f"frames {count(s['board_lost'])}, rejected {count(s['board_rejected'])}, "
            f"dropped {count(s['board_dropped'])}"
        )
        events = f"saturated {count(s['saturated_steps'])}, starved {count(s['starved_steps'])}"
        flags = None if s["flags_set"] is None else ", ".join(s["flags_set"]).replace("_", " ").lower() or "none"
        sticks = " ".join(f"{name} {value}" for name, value in (s.get("commands") or {}).items())
        neutral = f"no, the pins stay neutral; {blocked or 'nothing blocks arming'}"
        lost = s["host_lost_steps"] + s["host_lost"] + s["host_rejected"]
        return [
            *(_row(name.replace("_", " "), text) for name, text in s["choices"].items()),
            *([] if flags is None else [_row("flags", flags)]),
            *([_row("commands", sticks)] if sticks else []),
            _row("raw", " ".join(map(str, s["raw"])) if s["raw"] else "-"),
            _row("armed", "yes" if s["armed"] else neutral, "red" if s["armed"] else "yellow" if blocked else "green"),
            _row("faults", faults or "none", "bold red" if faults else "green"),
            *_battery(s),
            _row("last disarmed by", cause or "nothing", "yellow" if cause else ""),
            *(
                [_row("counters", "all zero: samples, CAN, frames lost here and by the board")]
                if all(s[name] == 0 for name in COUNTERS)
                else [
                    _row("events", events, "yellow" if s["saturated_steps"] or s["starved_steps"] else ""),
                    _row("can", f"{bus}, {errors}, times off {count(s['can_bus_offs'])}", off),
                    _row("lost here", here, "yellow" if lost else ""),
                    _row("lost by the board", there, "yellow" if s["board_lost"] or s["board_dropped"] else ""),
                ]
            ),
        ]


def _battery(s: Snapshot) -> list[RenderableType]:
    """The row of a board that has declared a battery."""
    if s["battery_v"] is None:
        return []
    trouble = "".join(f"; {text}" for text in s["battery_trouble"])
    return [_row("battery", f"{s['battery_v']:.2f} V, {s['battery_a']:.2f} A{trouble}", "bold red" if trouble else "")]


def _row(name: str, text: str, style: str = "") -> Table:
    """A name, and to its right a text that wraps."""
    row = Table.grid(padding=(0, 1))
    row.add_column(width=18, no_wrap=True)
    row.add_column(overflow="fold")
    row.add_row(Text(f" {name}", style="dim"), Text(text, style=style))
    return row
