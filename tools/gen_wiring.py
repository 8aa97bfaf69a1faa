"""Write docs/wiring/*.svg: the wiring of a Blue Pill, one drawing for each set of sensors.

The systems declare their wiring: `DRAWINGS` of host/plumb/systems/NAME/wiring.py.
"""

from __future__ import annotations

from html import escape
from pathlib import Path

from plumb import systems
from plumb.spec import declarations
from plumb.spec.pin_sets import PIN_SETS, STRAP
from plumb.systems.wiring import ANALOG, DRAIN, INPUT, OUTPUT, WIRING, Device, Drawing

ROOT = Path(__file__).resolve().parent.parent
FOLDER = ROOT / "docs" / "wiring"

LEFT_ROW = "PB12 PB13 PB14 PB15 PA8 PA9 PA10 PA11 PA12 PA15 PB3 PB4 PB5 PB6 PB7 PB8 PB9 5V GND 3V3"
RIGHT_ROW = "GND GND 3V3 RST PB11 PB10 PB1 PB0 PA7 PA6 PA5 PA4 PA3 PA2 PA1 PA0 PC15 PC14 PC13 VBAT"
"""The two rows of a Blue Pill, USB socket at the top; as printed on the common boards."""
LEFT, RIGHT = LEFT_ROW.split(), RIGHT_ROW.split()

COLOURS = {ANALOG: "#a86410", INPUT: "#2a5ca8", OUTPUT: "#1a7f47", DRAIN: "#7a3fa0"}
"""Role of a pin, seen from the STM32 -> colour."""
INK, FAINT, PAPER = "#1d2430", "#58626f", "#ffffff"

WIDTH, PITCH, TOP, HEAD, GAP = 1240, 24, 116, 28, 10
BOARD_X, BOARD_WIDTH, BOX_X, BOX_WIDTH = 520, 200, 24, 280
SUPPLY_WIDTH = 84
"""Width next to a box that is kept free of wires for the names of supplies."""


STRAP_TIES = {one.name: {pin: "to GND" if pin in one.grounded else "open" for pin in STRAP} for one in PIN_SETS}
"""Pin set -> strap, which is read once at the start and alone selects the pins of UART and actuators."""

DRAWINGS: tuple[Drawing, ...] = tuple(
    drawing
    for name in systems.with_part(WIRING.name)
    if declarations.system(name).shipped
    for drawing in systems.load(name, WIRING).DRAWINGS
)


def pin_place(pin: str) -> tuple[float, float]:
    """Position of a pin of the Blue Pill on the sheet."""
    row = (LEFT if pin in LEFT else RIGHT).index(pin)
    return BOARD_X if pin in LEFT else BOARD_X + BOARD_WIDTH, TOP + PITCH * (row + 0.5)


def text(x: float, y: float, words: str, colour: str = INK, size: int = 12, extra: str = "") -> str:
    return f'<text x="{x:g}" y="{y:g}" fill="{colour}" font-size="{size}"{extra}>{escape(words)}</text>'


def line(points: list[tuple[float, float]], colour: str) -> str:
    path = " ".join(f"{x:g},{y:g}" for x, y in points)
    return f'<polyline points="{path}" fill="none" stroke="{colour}" stroke-width="2"/>'


def blue_pill(drawing: Drawing) -> list[str]:
    used = {wire.pin: wire.role for wire in drawing.wires()}
    ties = STRAP_TIES[drawing.pins]
    height = PITCH * len(LEFT)
    middle, centred = BOARD_X + BOARD_WIDTH / 2, ' text-anchor="middle"'
    parts = [
        f'<rect x="{BOARD_X}" y="{TOP - 12}" width="{BOARD_WIDTH}" height="{height + 24}" rx="8" fill="#e8f0fb" '
        f'stroke="{COLOURS[INPUT]}"/>',
        f'<rect x="{middle - 30:g}" y="{TOP - 24}" width="60" height="24" rx="3" fill="#d5dae1" stroke="{FAINT}"/>',
        text(middle, TOP - 8, "USB", FAINT, 11, centred),
        text(middle, TOP + 170, "Blue Pill", INK, 16, centred + ' font-weight="600"'),
        text(middle, TOP + 190, "STM32F103C8", FAINT, 12, centred),
        text(middle, TOP + 214, f"pins: {drawing.pins}", INK, 12, centred),
        text(middle, TOP + height + 6, "SWD: 3V3 SWDIO SWCLK GND", FAINT, 10, centred),
    ]
    for names, x, anchor in ((LEFT, BOARD_X + 10, "start"), (RIGHT, BOARD_X + BOARD_WIDTH - 10, "end")):
        for row, pin in enumerate(names):
            role = used.get(pin) if names.index(pin) == row else None
            colour = COLOURS[role] if role else FAINT
            weight = ' font-weight="600"' if role else ""
            edge = BOARD_X if anchor == "start" else BOARD_X + BOARD_WIDTH
            y = TOP + PITCH * (row + 0.5)
            parts.append(f'<circle cx="{edge}" cy="{y:g}" r="4" fill="{colour if role else PAPER}" stroke="{colour}"/>')
            parts.append(text(x, y + 4, pin, colour, 12, f' text-anchor="{anchor}"{weight}'))
            if pin in ties and anchor == "start":
                parts.append(text(x + 32, y + 4, f"strap: {ties[pin]}", COLOURS[INPUT], 11))
    return parts


def placed(boxes: tuple[Device, ...]) -> list[tuple[Device, float]]:
    """Each box with the y coordinate of its upper edge, without overlaps."""
    places: list[tuple[Device, float]] = []
    free = float(TOP - 2 * PITCH)
    for box in boxes:
        upper = max(TOP + PITCH * box.row - HEAD, free)
        places.append((box, upper))
        free = upper + box_height(box) + GAP
    return places


def box_height(box: Device) -> float:
    return HEAD + PITCH * len(box.wires) + 6


def terminal(upper: float, index: int) -> float:
    """Height of a terminal on the sheet."""
    return upper + HEAD + PITCH * (index + 0.5)


def device(box: Device, upper: float, side: str) -> list[str]:
    x = BOX_X if side == "left" else WIDTH - BOX_X - BOX_WIDTH
    parts = [
        f'<rect x="{x}" y="{upper:g}" width="{BOX_WIDTH}" height="{box_height(box)}" rx="6" fill="#f6f7f9" '
        f'stroke="{FAINT}"/>',
        text(x + 8, upper + 18, box.title, INK, 12, ' font-weight="600"'),
    ]
    edge, inside, anchor = (x + BOX_WIDTH, x + BOX_WIDTH - 8, "end") if side == "left" else (x, x + 8, "start")
    away, far = (x + 8, "start") if side == "left" else (x + BOX_WIDTH - 8, "end")
    for index, wire in enumerate(box.wires):
        y = terminal(upper, index)
        parts.append(text(inside, y + 4, wire.label, INK, 12, f' text-anchor="{anchor}"'))
        parts.append(text(away, y + 4, wire.remark, "#b02a2a", 11, f' text-anchor="{far}"'))
        if not wire.role:
            out = 16 if side == "left" else -16
            parts.append(line([(edge, y), (edge + out, y)], FAINT))
            parts.append(text(edge + 1.3 * out, y + 4, wire.pin, FAINT, 11, f' text-anchor="{far}"'))
    return parts


def routes(drawing: Drawing, side: str) -> list[str]:
    """Wires of one side. Bends are ordered so that wires that keep the order of the pins do not cross: among those
    that lead down the upper ones bend later, among those that lead up earlier."""
    edge = BOX_X + BOX_WIDTH if side == "left" else WIDTH - BOX_X - BOX_WIDTH
    ends = [
        (terminal(upper, index), wire)
        for box, upper in placed(drawing.left if side == "left" else drawing.right)
        for index, wire in enumerate(box.wires)
        if wire.role
    ]
    down = [end for end in ends if pin_place(end[1].pin)[1] >= end[0]]
    order = [*reversed(down), *(end for end in ends if end not in down)]
    gap = (BOARD_X - BOX_X - BOX_WIDTH - SUPPLY_WIDTH - 20) / max(len(order), 1)
    parts = []
    for place, (start, wire) in enumerate(order):
        across = SUPPLY_WIDTH + gap * place
        bend = edge + across if side == "left" else edge - across
        x, y = pin_place(wire.pin)
        parts.append(line([(edge, start), (bend, start), (bend, y), (x, y)], COLOURS[wire.role or INPUT]))
    return parts


def svg(drawing: Drawing) -> str:
    boxes = [(box, upper, "left") for box, upper in placed(drawing.left)]
    boxes += [(box, upper, "right") for box, upper in placed(drawing.right)]
    lowest = max(TOP + PITCH * len(LEFT) + 30, *(upper + box_height(box) for box, upper, _ in boxes))
    height = lowest + 40 + 18 * (len(drawing.notes) + 1)
    width = WIDTH if drawing.right else BOARD_X + BOARD_WIDTH + BOX_X
    used = {wire.role for wire in drawing.wires()}
    legend: list[str] = []
    for place, (role, colour) in enumerate((role, colour) for role, colour in COLOURS.items() if role in used):
        x = 24.0 + 165 * place
        legend.append(line([(x, 52), (x + 24, 52)], colour))
        legend.append(text(x + 30, 56, f"{role} of the STM32", FAINT, 11))
    notes = [text(24, lowest + 34 + 18 * row, note, INK, 12) for row, note in enumerate(drawing.notes)]
    parts = [
        "<!-- GENERATED by tools/gen_wiring.py from the wiring.py of a system: change that, then run it. -->",
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height:g}" '
        'font-family="system-ui, sans-serif">',
        f"<title>{escape(drawing.title)}</title>",
        f'<rect width="{width}" height="{height:g}" fill="{PAPER}"/>',
        text(24, 30, drawing.title, INK, 18, ' font-weight="600"'),
        *legend,
        *[part for box, upper, side in boxes for part in device(box, upper, side)],
        *routes(drawing, "left"),
        *routes(drawing, "right"),
        *blue_pill(drawing),
        *notes,
        "</svg>",
    ]
    return "\n".join(parts) + "\n"


def generate() -> dict[str, str]:
    """File name -> text."""
    return {f"{drawing.name}.svg": svg(drawing) for drawing in DRAWINGS}


def main() -> None:
    FOLDER.mkdir(parents=True, exist_ok=True)
    drawn = generate()
    for name, content in drawn.items():
        (FOLDER / name).write_text(content, encoding="utf-8")
    for path in FOLDER.glob("*.svg"):
        if path.name not in drawn:
            path.unlink()  # of a system that is no more


if __name__ == "__main__":
    main()
