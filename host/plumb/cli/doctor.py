"""Check this machine: libraries, tools, the flash image, serial ports, drivers, who else takes ports; and a board.

    plumb doctor
    plumb doctor --board serial:/dev/ttyUSB0       the board's identity, its faults, and what blocks arming
    plumb doctor --board auto                      the only board that is here
    plumb doctor --probe openocd                   the chip at a debug probe, and whether it is a clone; it is reset

Below a line that is not ok stands the command that mends it. For a serial port where no board answers it says why: in
use, no permission, another baud rate, BOOT0 at 1, another program on the chip, or silence. Exit code 0 when `plumb
demo` can run, else 2; 1 when the board has a fault or does not match this version of plumb, 3 when it does not answer.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import shutil
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from plumb.cli import options
from plumb.extras import install_hint
from plumb.link.findings import Finding

if TYPE_CHECKING:
    from plumb.link.identity import Identity
    from plumb.link.session import Session


def add_arguments(parser: argparse.ArgumentParser) -> None:
    options.add_board(parser, linked=True, required=False, about="check this board, too")
    options.add_link(parser)
    parser.add_argument("--probe", metavar="openocd[:INTERFACE]|pyocd", help="check the chip at this debug probe, too")
    options.add_json(parser)


def main(arguments: argparse.Namespace) -> int:
    from plumb.errors import ExitCode, LinkError
    from plumb.link.host_checks import host_checks

    if not arguments.board:
        options.check_of_virtual(arguments)
    findings = [package(), *libraries(), *tools(), native_core(), image(), *host_checks()]
    code = ExitCode.WRONG_USE if failures(findings) else ExitCode.GOOD
    about: list[Finding] = []
    if arguments.probe:
        about += probed(arguments.probe)
    if arguments.board:
        try:
            about += board(arguments.board, arguments.link)
        except LinkError as error:
            about += silent(arguments.board, error)
            code = ExitCode.LINK_TROUBLE
    if failures(about) and code == ExitCode.GOOD:
        code = ExitCode.BAD_VERDICT
    findings += about
    if arguments.json:
        print(json.dumps({"good": not failures(findings), "findings": [asdict(finding) for finding in findings]}))
        return code
    for finding in findings:
        mark = "ok  " if finding.good else ("MISS" if finding.needed else "-   ")
        print(f"{mark} {finding.what}: {finding.detail}" + f"\n       {finding.mend}" * bool(finding.mend))
    return code


def failures(findings: list[Finding]) -> list[Finding]:
    return [finding for finding in findings if finding.needed and not finding.good]


def silent(spec: str, error: Exception) -> list[Finding]:
    """Why the board did not answer, as far as its port shows."""
    from plumb.flash.silent_port import diagnose
    from plumb.link.endpoint_names import SerialName, parse_board

    name = parse_board(spec)
    found = [Finding("board", False, True, str(error))]
    return found + list(diagnose(name)) if isinstance(name, SerialName) else found


def probed(spec: str) -> list[Finding]:
    """The chip at a debug probe; it is reset."""
    from plumb.flash.debug_probe import CLONE_IDCODE, open_probe

    tool = open_probe(spec)
    chip = tool.identify()
    tool.start()
    found = [Finding("probe", True, False, f"{chip.part.density}, flash {chip.part.flash_kib} KiB")]
    if chip.clone:
        detail = f"the debug port says 0x{CLONE_IDCODE:08x}, and ST's says 0x1ba01477: the chip is a clone"
        found.append(
            Finding("clone", False, False, detail, "use it for trials; for flights take a board with ST's chip")
        )
    return found


def libraries() -> Iterator[Finding]:
    from importlib import metadata

    for name, needed, remedy in (
        ("numpy", True, "pip install numpy"),
        ("python-can", True, "pip install python-can"),
        ("pyserial", True, "pip install pyserial"),
        ("cantools", True, "pip install cantools"),
        ("unicorn", True, f"for the virtual board, {install_hint('virtual')}"),
        ("capstone", False, f"for plumb bench, {install_hint('bench')}"),
        ("stm32loader", False, f"for plumb flash, {install_hint('flash')}"),
        ("rich", False, f"for the display of plumb monitor, {install_hint('monitor')}"),
        ("aiohttp", False, f"for plumb cockpit, {install_hint('cockpit')}"),
        ("vqf", False, f"for plumb compare, {install_hint('compare')}"),
        ("AHRS", False, f"for plumb compare, {install_hint('compare')}"),
        ("scipy", False, f"for plumb tune, {install_hint('tune')}"),
    ):
        try:
            yield Finding(name, True, needed, metadata.version(name))
        except metadata.PackageNotFoundError:
            yield Finding(name, False, needed, remedy)


def tools() -> Iterator[Finding]:
    for command, purpose, package in (
        ("arm-none-eabi-gcc", "builds the flash image", "gcc-arm-none-eabi libnewlib-arm-none-eabi"),
        ("qemu-system-arm", "runs the core on a second CPU", "qemu-system-arm"),
        ("cmake", "builds everything", "cmake"),
        ("openocd", "plumb flash --probe openocd", "openocd"),
    ):
        path = shutil.which(command)
        mend = "" if path else f"sudo apt install {package}"
        yield Finding(command, path is not None, False, path or purpose, mend)


def native_core() -> Finding:
    from plumb.boards.native import build as native_build
    from plumb.boards.native import core as native
    from plumb.errors import UsageError

    try:
        stale = native_build.stale_text(native.core_path())
        return Finding("native core", not stale, True, stale or str(native.core_path()))
    except UsageError as error:
        return Finding("native core", False, True, str(error))


def image() -> Finding:
    from plumb.errors import UsageError
    from plumb.flash.image import find_image, load_image, own_header

    try:
        path = find_image(None)
        data = load_image(path)
        header = own_header(data, str(path))
    except UsageError as error:
        return Finding("flash image", False, True, str(error))
    commit = (header.git_hash or "unknown") + "+" * header.git_dirty
    sha256 = hashlib.sha256(path.read_bytes()).hexdigest()
    return Finding("flash image", True, True, f"{path}: commit {commit}, {systems_of(path)}, SHA-256 {sha256}")


def systems_of(path: Path) -> str:
    """The systems of an image, from the package's manifest, or by running the image on the virtual board."""
    from plumb.errors import PlumbError
    from plumb.flash.packaged_images import packaged_images

    for packaged in packaged_images().values():
        if packaged.path == path:
            return "systems " + ", ".join(packaged.systems)
    try:
        from plumb.boards.virtual import VirtualBoard

        with VirtualBoard(path) as board:
            identity = board.session.identity or board.session.connect()
            return "systems " + ", ".join(identity.systems)
    except PlumbError:
        return "systems not known without the virtual board"


def package() -> Finding:
    from plumb.checkout import PACKAGE
    from plumb.version import installed

    return Finding("plumb", True, True, f"{installed().version}, commit {installed().commit or 'unknown'}, {PACKAGE}")


def pins(session: Session, identity: Identity) -> Finding:
    """The pin set of the strap, and that of the parameters if it differs."""
    from plumb.link.identity import FAULT_STRAP, PINS
    from plumb.spec import parameters

    chosen = PINS.get(identity["PINS"], "unknown")
    if not identity["FAULTS"] >> FAULT_STRAP & 1:
        return Finding("pins", True, False, chosen)
    place = next(index for index, row in enumerate(parameters.table()) if row.name == "pins")
    asked = session.read_parameters()[place]
    now = f"the parameters are for {PINS.get(asked, 'unknown')}"
    later = ", from the next start on" if asked == identity["PINS"] else ""
    return Finding("pins", False, True, f"the strap says {chosen}; {now}{later}")


def update(identity: Identity) -> str:
    """The command that makes board and plumb match; "" when they do."""
    from plumb.checkout import IN_CHECKOUT
    from plumb.spec.protocol import protocol

    if not identity.mismatch:
        return ""
    if identity["PROTOCOL_VERSION"] > protocol().version:
        return "git pull, then make image native" if IN_CHECKOUT else "pip install --upgrade plumb-imu"
    return "plumb flash --port auto"


def board(spec: str, link: str = "serial") -> list[Finding]:
    """The board's identity, faults and arming state. Raises LinkError if it does not answer, UsageError for a wrong
    name."""
    from plumb.boards import open_link_board
    from plumb.link.identity import BLOCKING_FAULTS, FAULTS, HOST_BLOCKS
    from plumb.link.monitor import STATUS_EVERY_S
    from plumb.link.unarmable import blocked_texts

    with open_link_board(spec, link=link) as opened:
        session = opened.session
        identity = session.identity or session.connect()
        commit, mismatch = identity.git_hash or "of no known commit", identity.mismatch
        flash_kib = identity["FLASH_KIB"] or "64 or more (size not readable)"
        found = [
            Finding("board", not mismatch, True, mismatch or f"{identity.unique_id}, image {commit}", update(identity)),
            Finding("chip", True, False, f"flash {flash_kib} KiB, RAM {identity['RAM_KIB']} KiB"),
            Finding("last reset", "watchdog" not in identity.reset_cause, False, identity.reset_cause),
            Finding("systems", True, False, identity.systems_text),
            Finding("parameters", True, False, identity.parameter_source),
            pins(session, identity),
        ]
        if identity["CRASH_PC"] or identity["CRASH_EXCEPTION"]:
            crash = f"exception {identity['CRASH_EXCEPTION']} at 0x{identity['CRASH_PC']:08x} ended the run before"
            found.append(Finding("crash", False, False, f"{crash}: addr2line -e firmware.elf names the line"))
        faults = [(bit, text) for bit, text in FAULTS.items() if identity["FAULTS"] >> bit & 1]
        found += [Finding("fault", False, bit in BLOCKING_FAULTS, text) for bit, text in faults]
        status = session.listening.timeout(2 * STATUS_EVERY_S)
        while "STATUS" not in session.telemetry and not status.over:
            session.receive(STATUS_EVERY_S / 10)
        blocked = session.telemetry.get("STATUS", {}).get("blocked", 0)
        blocked &= ~sum(1 << bit for bit in HOST_BLOCKS)
        found += [Finding("arming", False, False, text) for text in blocked_texts(session, blocked)]
    return found
