"""Write docs/wiring/*.svg: a Blue Pill and what belongs on its pins, one drawing for each set of sensors.

What is wired is data here; what the firmware makes of each pin is not: tests/f103/test_f103_wiring.py holds every wire
against the pin modes of the booted image.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from html import escape
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
FOLDER = ROOT / "docs" / "wiring"

LEFT_ROW = "PB12 PB13 PB14 PB15 PA8 PA9 PA10 PA11 PA12 PA15 PB3 PB4 PB5 PB6 PB7 PB8 PB9 5V GND 3V3"
RIGHT_ROW = "GND GND 3V3 RST PB11 PB10 PB1 PB0 PA7 PA6 PA5 PA4 PA3 PA2 PA1 PA0 PC15 PC14 PC13 VBAT"
"""The two rows of a Blue Pill, USB socket at the top; as printed on the common boards."""
LEFT, RIGHT = LEFT_ROW.split(), RIGHT_ROW.split()

ANALOG, INPUT, OUTPUT, DRAIN = "analog", "input", "output", "open drain"
COLOURS = {ANALOG: "#a86410", INPUT: "#2a5ca8", OUTPUT: "#1a7f47", DRAIN: "#7a3fa0"}
"""What the STM32's pin is, seen from the STM32."""
INK, FAINT, PAPER = "#1d2430", "#58626f", "#ffffff"

WIDTH, PITCH, TOP, HEAD, GAP = 1240, 24, 116, 28, 10
BOARD_X, BOARD_WIDTH, BOX_X, BOX_WIDTH = 520, 200, 24, 280
SUPPLY_WIDTH = 84
"""Beside a box, kept free of wires for the names of supplies."""


@dataclass(frozen=True)
class Wire:
    """One terminal of a device. pin: of the Blue Pill, or a supply; role: None for a supply."""

    label: str
    pin: str
    role: str | None = None
    remark: str = ""


@dataclass(frozen=True)
class Device:
    title: str
    wires: tuple[Wire, ...]
    row: float
    """Of the Blue Pill's pins, beside which its first terminal is to lie; lower where the box above reaches down."""


@dataclass(frozen=True)
class Drawing:
    name: str
    title: str
    pins: str
    """The pin set, as the parameter `pins` names it."""
    left: tuple[Device, ...] = ()
    right: tuple[Device, ...] = ()
    notes: tuple[str, ...] = field(default=())

    def wires(self) -> list[Wire]:
        """Those that end on a pin."""
        return [wire for device in self.left + self.right for wire in device.wires if wire.role]


SWITCH = Device("arm switch (optional)", (Wire("closed = armed", "PC14", INPUT), Wire("", "GND")), 17.5)
ADAPTER = Device(
    "USB-serial adapter, 3.3 V",
    (Wire("RX", "PA9", OUTPUT), Wire("TX", "PA10", INPUT), Wire("GND", "GND")),
    4.5,
)
CAN = Device(
    "CAN transceiver, 3.3 V (optional)",
    (Wire("RXD", "PA11", INPUT), Wire("TXD", "PA12", OUTPUT), Wire("VCC, GND", "3V3 GND")),
    8.6,
)
SPEED_CONTROLLERS = Device(
    "two speed controllers",
    (
        Wire("signal 0", "PB6", OUTPUT, "10 kΩ to GND"),
        Wire("signal 1", "PB7", OUTPUT, "10 kΩ to GND"),
        Wire("GND of both", "GND"),
    ),
    13.4,
)
STRAP_TIES = {"standard": {"PB4": "open", "PB5": "open"}, "bridge": {"PB4": "open", "PB5": "to GND"}}
"""The strap by pin set: read once at the start, it alone decides where UART and actuators are."""
STRAP_NOTE = "The strap chooses the pin set at the start. Nothing on PB4 and PB5: standard."
COMMON = "Power: 5 V from USB or from the adapter, never both. Every GND is the same wire."
CAN_POWER = (
    "With CAN: power by the pin 5V, or by a USB cable without data wires. PA11 and PA12 are the data lines of the USB",
    "socket, and a charger shorts the two.",
)
PULL_DOWNS = "10 kΩ to GND at every signal: from power-on until the pins are set up nothing else keeps it low."
SWITCH_NOTE = "The arm switch is the dead man's handle: closed it arms without any host, open it lets go at once."

BRIDGE = (
    Device(
        "three-phase bridge, with gate driver",
        (
            Wire("/FAULT (open drain)", "PB12", INPUT, "4.7 kΩ to 3V3"),
            Wire("gate A low", "PB13", OUTPUT, "10 kΩ to GND"),
            Wire("gate B low", "PB14", OUTPUT, "10 kΩ to GND"),
            Wire("gate C low", "PB15", OUTPUT, "10 kΩ to GND"),
            Wire("gate A high", "PA8", OUTPUT, "10 kΩ to GND"),
            Wire("gate B high", "PA9", OUTPUT, "10 kΩ to GND"),
            Wire("gate C high", "PA10", OUTPUT, "10 kΩ to GND"),
            Wire("logic GND", "GND"),
        ),
        -1,
    ),
    Device(
        "Hall sensors of the motor",
        (
            Wire("A", "PA15", INPUT, "4.7 kΩ to 3V3"),
            Wire("B", "PB3", INPUT, "4.7 kΩ to 3V3"),
            Wire("supply, GND", "5V GND"),
        ),
        8.6,
    ),
    Device("strap: pin set bridge", (Wire("jumper", "PB5", INPUT), Wire("", "GND")), 12),
    Device(
        "USB-serial adapter, 3.3 V",
        (
            Wire("RX", "PB6", OUTPUT),
            Wire("TX", "PB7", INPUT, "1 kΩ in series"),
            Wire("GND", "GND"),
        ),
        14.4,
    ),
)
"""Left of the Blue Pill wherever its pins are the bridge's."""
HALL_C = Device("Hall sensors of the motor", (Wire("C", "PB10", INPUT, "4.7 kΩ to 3V3"),), 5)
BRIDGE_NOTES = (
    "10 kΩ to GND at every gate input are a must: until the pins are set up, they alone keep the bridge off.",
    "/FAULT low, or its wire off, switches off without any software. A driver without one: tie PB12 to 3V3.",
    "The strap comes first: with PB5 at GND the UART is on PB6, PB7, and no gate is driven before the parameter pins",
    "agrees (plumb params tuning balancer --save, reset). Without the strap PB7 is an output: the 1 kΩ protects it.",
)
BRIDGE_CAN = ("CAN as in quad.svg.", *CAN_POWER)


def i2c(title: str, owner: str, supplies: tuple[Wire, Wire]) -> Device:
    """What is on the two wires of I2C1."""
    pulled = "2.2 kΩ to 3V3"
    lines = (Wire(f"SCL{owner}", "PB8", DRAIN, pulled), Wire(f"SDA{owner}", "PB9", DRAIN, pulled))
    return Device(title, lines + supplies, 19.2)


DRAWINGS = (
    Drawing(
        "quad",
        "quad: analog gyro and accelerometer, two speed controllers",
        "standard",
        left=(ADAPTER, CAN, SPEED_CONTROLLERS),
        right=(
            Device(
                "MMA7260 accelerometer, 1.5 g",
                (
                    Wire("Z, second axis", "PA2", ANALOG),
                    Wire("Y, the tilt axis", "PA1", ANALOG),
                    Wire("VDD, /SLEEP", "3V3"),
                    Wire("GND, g-select 1, 2", "GND"),
                ),
                8,
            ),
            Device(
                "ENC-03 gyro",
                (Wire("OUT", "PA0", ANALOG), Wire("VCC, GND", "3V3 GND")),
                13.6,
            ),
            SWITCH,
        ),
        notes=(
            COMMON,
            *CAN_POWER,
            STRAP_NOTE,
            PULL_DOWNS,
            "Speed controllers, one-way PWM, have a battery of their own: leave the red wire of their plug open.",
            "Propellers off until the rest works.",
            SWITCH_NOTE,
        ),
    ),
    Drawing(
        "balancer",
        "balancer: digital sensors, three-phase bridge, Hall sensors",
        "bridge",
        left=(
            *BRIDGE,
            i2c(
                "ITG-3205 and ADXL345",
                " of both",
                (Wire("VDD, VLOGIC; ADXL345's /CS", "3V3"), Wire("GND; SDO, AD0, CLKIN", "GND")),
            ),
        ),
        right=(HALL_C, SWITCH),
        notes=(*BRIDGE_NOTES, *BRIDGE_CAN, SWITCH_NOTE),
    ),
    Drawing(
        "balancer_spi",
        "balancer, its accelerometer on SPI",
        "bridge",
        left=(*BRIDGE, i2c("ITG-3205", "", (Wire("VDD, VLOGIC", "3V3"), Wire("GND; AD0, CLKIN", "GND")))),
        right=(
            HALL_C,
            Device(
                "ADXL345",
                (
                    Wire("SDA (data in)", "PA7", OUTPUT),
                    Wire("SDO (data out)", "PA6", INPUT),
                    Wire("SCL (clock)", "PA5", OUTPUT),
                    Wire("/CS", "PA4", OUTPUT),
                    Wire("VDD, GND", "3V3 GND"),
                ),
                8,
            ),
            SWITCH,
        ),
        notes=(
            *BRIDGE_NOTES,
            "The board has to be told where the accelerometer is: plumb params set accel_bus=1 --save.",
            *BRIDGE_CAN,
            SWITCH_NOTE,
        ),
    ),
    Drawing(
        "turntable",
        "turntable: three gyro and three angular-acceleration inputs",
        "standard",
        left=(ADAPTER, CAN),
        right=(
            Device(
                "angular acceleration, 0 to 3.3 V",
                (
                    Wire("Z", "PB1", ANALOG),
                    Wire("Y", "PB0", ANALOG),
                    Wire("X", "PA3", ANALOG),
                    Wire("supply, GND", "3V3 GND"),
                ),
                3.4,
            ),
            Device(
                "gyros, 0 to 3.3 V",
                (
                    Wire("Z", "PA2", ANALOG),
                    Wire("Y", "PA1", ANALOG),
                    Wire("X", "PA0", ANALOG),
                    Wire("supply, GND", "3V3 GND"),
                ),
                12,
            ),
        ),
        notes=(
            COMMON,
            *CAN_POWER,
            STRAP_NOTE,
            "Outputs above 3.3 V need a divider; sources of up to 50 kΩ are fine. This system moves nothing.",
        ),
    ),
    Drawing(
        "phone",
        "phone: samples come over the link, nothing is wired but that",
        "standard",
        left=(ADAPTER, CAN),
        notes=(
            COMMON,
            *CAN_POWER,
            STRAP_NOTE,
            "The phone talks to the host by UDP, the host to the board. This system moves nothing.",
        ),
    ),
)


def pin_place(pin: str) -> tuple[float, float]:
    """Where a pin of the Blue Pill is on the sheet."""
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
    """Each box with its upper edge, none over another."""
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
        "<!-- GENERATED by tools/gen_wiring.py: change that, then run it. -->",
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
    for name, content in generate().items():
        (FOLDER / name).write_text(content, encoding="utf-8")


if __name__ == "__main__":
    main()
