"""Run one row of the fault table on the first system that has it, in a process of its own; prints JSON. The systems of
the image of all systems come first: a row that one of them has needs no other image. A row of pilots alone is for the
system that flies: the image of all systems, which lacks it, may be that of another defect.

    python -m support.fault_row NAME[@FEATURE] PHASES

FEATURE: only on a system with this feature (Scene.features), where several rows have one name.
"""

from __future__ import annotations

import hashlib
import json
import sys

from plumb.errors import LinkError
from plumb.flash.image import find_image
from plumb.proof.faults import table
from plumb.proof.faults.runner import Runner
from plumb.proof.faults.scene import scenarios_of
from plumb.spec import images
from support.defect_tree import system_of_row


def run(name: str, phases: int) -> tuple[str, str]:
    """Why the row fails on this checkout's image, "" when it passes, and the system that has it. Raises ValueError for
    a row that no system has."""
    name, _, feature = name.partition("@")
    faults = [fault for fault in table.FAULTS if fault.name == name]
    alone = system_of_row(name)
    by_image = sorted(table.tested_systems(), key=lambda system: images.running(system) is not None)
    for system in by_image if alone is None else [alone]:
        with Runner(system, phases=phases, scenario=scenarios_of(system)[0]) as runner:
            try:
                here = feature in ("", *runner.scene("serial")[0].features)
                found = [fault for fault in faults if here and runner.applies(fault)]
                if found:
                    return runner.run(found[0]).why, system
            except LinkError as error:
                return f"{system} cannot be armed: {error}", system
    raise ValueError(f"no system has a row '{name}'")


if __name__ == "__main__":
    why, ran_on = run(sys.argv[1], int(sys.argv[2]))
    image = find_image(images.running(ran_on))
    print(json.dumps({"why": why, "image": hashlib.sha256(image.read_bytes()).hexdigest(), "path": str(image)}))
