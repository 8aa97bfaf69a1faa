"""Identity of a board, and the text of its refusals, faults and reports."""

from __future__ import annotations

from dataclasses import dataclass

from plumb.errors import LinkError
from plumb.spec import armed_values, declarations, images, parameters, status_bits
from plumb.spec.pin_sets import PIN_SETS
from plumb.spec.protocol import Protocol
from plumb.spec.system import CHECKED_CHANNELS

BLOCKED = {bit: one.text for bit, one in status_bits.BLOCKED.items()}
UNSAFE_BLOCK = 14
"""Blocking reason: a parameter in use with which an armed board would break a promise."""
HOST_BLOCKS = (0, 1, 3, 13)
"""Blocking reasons that a host does not report: it clears them by itself, or reports each fault separately."""
FAULT_STRAP = 15
BLOCKING_FAULTS = (*range(8), 13, 14, FAULT_STRAP)
FAULTS = {bit: one.text for bit, one in status_bits.FAULTS.items()}
PINS = {
    **{number: one.name for number, one in enumerate(PIN_SETS)},
    len(PIN_SETS): "none: PB4 or PB5 is not steady; no actuator pin is driven",
}
"""Pin set that the strap chose at the start: item PINS. The parameter pins has all but the last."""
SOURCES = {
    0: "factory defaults",
    1: "saved in flash",
    2: "factory defaults: what was saved is damaged",
    3: "factory defaults: what was saved contradicts itself or this image's limits",
    4: "set by a host and not saved",
}
"""PARAMETER_SOURCE: where the parameters in use come from."""
RESET_CAUSES = {2: "reset pin", 3: "power", 4: "software", 5: "watchdog", 6: "window watchdog", 7: "low power"}
"""RESET_CAUSE: RCC_CSR 31..24 (RM0008 7.3.10). Every reset also pulls the pin."""
SENSOR_CAUSES = {value: one.text for value, one in status_bits.SENSOR_STATES.items() if value}
_REASONS = {
    "UNSUPPORTED": "this image cannot do that",
    "COUNT": "it has another number of parameters",
    "CRC": "the staged table is not the one that was meant",
    "PARAMETERS": "the parameters contradict each other",
    "BUSY": "a run is on",
    "NONCE": "the nonce was not fresh",
    "NO_RUN": "no run is on",
    "FLASH": "its flash does not take it, what was saved before is still there",
    "NOTHING_SAVED": "nothing is saved",
    "OWNER": "this run takes them from another link, or from the receiver on the board",
    "RUN_TAG": "it is for another run",
    "ARMED": "while it is armed, only gains of controllers change, to twice or half of what they were at arming",
    "GREETING": "no host of its version has connected over this link",
}


def bits_text(bits: int, names: dict[int, str]) -> str:
    """The meaning of the bits that are set, joined; 'none' for 0."""
    return "; ".join(names.get(bit, f"bit {bit}") for bit in range(32) if bits >> bit & 1) or "none"


def sensors_text(said: dict[str, int]) -> list[str]:
    """A sentence for every sensor that cannot be trusted, from the words of SENSORS by name."""
    analog, digital = said.get("analog", 0), said.get("digital", 0)
    inputs = [f"input {pin}" for pin in status_bits.ANALOG_INPUTS]
    if said.get("injected"):
        inputs = [f"injected channel {i}" for i in range(CHECKED_CHANNELS)]
    found = [f"{name} is at a rail" for i, name in enumerate(inputs) if analog >> i & 1]
    found += [f"{name} does not change" for i, name in enumerate(inputs) if analog >> (8 + i) & 1]
    for name, cause in (("gyro", digital & 0xFF), ("accelerometer", digital >> 8)):
        found += [f"{name}: {SENSOR_CAUSES.get(cause, f'cause {cause}')}"] if cause else []
    return found


NOT_READY = {bit: one.text for bit, one in status_bits.NOT_READY.items()}


def implausible(system: str | None) -> dict[int, str]:
    """Bit of PLAUSIBILITY.failed and disarmed_by -> its text on a board that runs this system; None: not known."""
    checks = {bit: one.text for bit, one in status_bits.IMPLAUSIBLE.items()}
    return checks | status_bits.own_check_texts(system, "fails") | status_bits.stop_reason_texts(system)


def plausibility_text(said: dict[str, int], system: str | None) -> list[str]:
    """A sentence for every check that fails and every condition for arming that is missing, from PLAUSIBILITY.
    system: that the board runs, None where it is not known."""
    failed, missing = said.get("failed", 0), said.get("missing", 0)
    # SETTLING is only reported when no other condition is missing.
    missing &= ~1 if missing & ~1 else ~0
    found = [text for bit, text in implausible(system).items() if failed >> bit & 1]
    not_ready = NOT_READY | status_bits.own_check_texts(system, "unready")
    return found + [text for bit, text in not_ready.items() if missing >> bit & 1]


KEEPALIVE_LOST = 1 << 5


def disarmed_text(cause: int, said: dict[str, int], system: str | None, unread: str = "") -> str:
    """Why the board disarmed, from EVENTS.disarm_cause and the last PLAUSIBILITY. system: that it runs, None where it
    is not known. unread: what follows a keep-alive that was lost."""
    checks = bits_text(said.get("disarmed_by", 0), implausible(system))
    text = bits_text(cause, BLOCKED) + (unread if cause & KEEPALIVE_LOST else "")
    return f"{text}: {checks}" if cause & (1 << 11 | 1 << 15) and checks != "none" else text


@dataclass(frozen=True)
class Identity:
    """Identity of a board, from its reply to HELLO. items: every item of IDENTITY by its name in the DBC."""

    items: dict[str, int]
    mismatch: str | None

    def __getitem__(self, item: str) -> int:
        return self.items.get(item, 0)

    @property
    def git_hash(self) -> str:
        """First 16 digits of the image's commit, with '+' when the tree differed from it; '' when unknown."""
        if not self["GIT_HASH_0"] and not self["GIT_HASH_1"]:
            return ""
        return f"{self['GIT_HASH_0']:08x}{self['GIT_HASH_1']:08x}" + ("+" if self["GIT_DIRTY"] else "")

    @property
    def systems(self) -> tuple[str, ...]:
        """The systems of the image that this version of plumb knows."""
        has = self.items.get("SYSTEMS", 0)
        return tuple(system.name for system in declarations.systems().values() if has >> system.number & 1)

    @property
    def systems_text(self) -> str:
        """The systems of the image, and the image's name where it has one (`plumb.spec.images`)."""
        name = images.of_systems(self.systems).name
        return (", ".join(self.systems) or "no system that is known") + (f" (image {name})" if name else "")

    @property
    def image_text(self) -> str:
        """The image by commit and systems."""
        return f"image {self.git_hash or 'of no known commit'} with {self.systems_text}"

    @property
    def parameter_source(self) -> str:
        """Source of the parameters in use, in words."""
        source = self["PARAMETER_SOURCE"]
        text = SOURCES.get(source, f"source {source}")
        if source != 1:
            return text
        counts = ((self["SAVED_UNKNOWN"], "unknown to this image"), (self["SAVED_MISSING"], "missing, at defaults"))
        return ", ".join([f"{text}, number {self['SAVED_SEQUENCE']}", *(f"{n} {what}" for n, what in counts if n)])

    @property
    def reset_cause(self) -> str:
        """Cause of the last reset, in words: the pin only when there is no other cause."""
        cause = self["RESET_CAUSE"]
        return bits_text(cause & ~4 if cause & ~4 else cause, RESET_CAUSES)

    @property
    def unique_id(self) -> str:
        return "".join(f"{self[f'UNIQUE_ID_{i}']:08x}" for i in range(3))


def identity_of(items: dict[int, int], mine: Protocol, parameter_count: int) -> Identity:
    """The identity from the items of IDENTITY by number, with the differences from this version of plumb in words."""
    message = mine["IDENTITY"]
    named = {message.choice("item", item): value for item, value in items.items()}
    version, dbc_hash = named.get("PROTOCOL_VERSION", 0), named.get("DBC_HASH", 0)
    mismatch = None
    if version != mine.version:
        older = "the board's image" if version < mine.version else "this plumb"
        mismatch = (
            f"the board speaks protocol version {version}, this plumb version {mine.version}: update {older}; "
            "reading works, arming does not"
        )
    elif dbc_hash != mine.dbc_hash:
        mismatch = (
            f"the board was built from other message definitions ({dbc_hash:08x}) than this plumb "
            f"({mine.dbc_hash:08x}): flash the image that belongs to it; reading works, arming does not"
        )
    elif named.get("PARAMETER_COUNT") != parameter_count:
        mismatch = (
            f"the board has {named.get('PARAMETER_COUNT')} parameters, this plumb {parameter_count}: "
            "flash the image that belongs to it; reading works, arming does not"
        )
    return Identity(named, mismatch)


class NackError(LinkError):
    """The board refused a request. reason: its name in the DBC."""

    def __init__(self, reason: str, detail: int, text: str) -> None:
        super().__init__(text)
        self.reason = reason
        self.detail = detail


def nack_error(mine: Protocol, said: dict[str, int], identity: Identity | None = None) -> NackError:
    """The error for a NACK, from its words by name. identity: of the board, where it is known."""
    request = mine.by_identifier.get(said["request"])
    reason = mine["NACK"].choice("reason", said["reason"])
    detail = said["detail"]
    name = request.name if request else hex(said["request"])
    if reason == "BLOCKED":
        why = bits_text(detail, BLOCKED)
    elif reason == "ARMED" and name != "PARAM_COMMIT":
        why = "a pilot's switch holds it armed"
    elif reason == "UNSAFE_PARAMETER":
        why = armed_values.reason(detail)
    elif reason in ("RANGE", "INDEX") and detail < len(parameters.table()):
        row = parameters.table()[detail]
        absent = images.not_held(row.group, identity.systems) if identity else ""
        why = f"parameter {row.name} is outside {row.min} to {row.max}"
        if absent:
            why = f"{absent}; {row.name} stays at its factory value, {row.default}"
    else:
        why = _REASONS.get(reason, reason.lower().replace("_", " "))
    return NackError(reason, detail, f"the board refused {name}: {why}")
