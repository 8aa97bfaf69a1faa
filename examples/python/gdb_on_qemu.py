"""A golden vector under gdb: writes what the Cortex-M3 program reads, and says how to stop in the step.

VECTOR=balancer_rough_tuned python examples/python/gdb_on_qemu.py     in a checkout, after make image
"""

import os
from pathlib import Path

from plumb.boards.qemu import INPUT, QemuBoard, input_file
from plumb.checkout import CHECKOUT
from plumb.proof.golden import vectors_folder
from plumb.proof.golden_file import Vector

vector = Vector.read(vectors_folder() / f"{os.environ.get('VECTOR', 'quad_motion_adaptive')}.golden")
Path(INPUT).write_bytes(input_file(vector.params, (), vector.raw, vector.setpoint))
system = vector.params.system
qemu, *options, program = QemuBoard().command(system)
elf = Path(program).relative_to(CHECKOUT)
print(f"{len(vector.raw)} steps of {system} in {INPUT}. Here:")
print(" ".join([Path(qemu).name, *options[:4], "\\"]))
print(" ".join(["   ", *options[4:-1], "-S", "-s", options[-1], str(elf)]))
print("and in another terminal:")
print(f"gdb-multiarch {elf} -ex 'target remote :1234' -ex 'break plumb_{system}_step' -ex continue")

# Prints:
#     6000 steps of quad in plumb-in.bin. Here:
#     qemu-system-arm -M mps2-an385 -icount shift=5 \
#         -nographic -semihosting-config enable=on,target=native -S -s -kernel build/stm32f103/plumb_qemu.elf
#     and in another terminal:
#     gdb-multiarch build/stm32f103/plumb_qemu.elf -ex 'target remote :1234' -ex 'break plumb_quad_step' -ex continue
