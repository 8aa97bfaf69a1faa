"""The timing model gives what the processor manual's table gives, instruction by instruction and in sequence."""

from __future__ import annotations

import random
import shutil
import subprocess
from itertools import pairwise
from pathlib import Path

import pytest

pytest.importorskip("capstone")

from plumb.bench.m3_timing import Decoder, Instruction, path_cost
from plumb.bench.path_costs import PathCosts

RETURN = "7047"  # bx lr: 1 + refill of 2
ADD, NOP = "0844", "00bf"
LOAD_R0_R1, LOAD_R2_R1, LOAD_R2_R0 = "0868", "4a68", "0268"
STORE_R2_R1, STORE_R2_R1_R3 = "8a60", "ca50"
SMULL, SMLAL, UMULL = "82fb0301", "c2fb0301", "a2fb0301"
UDIV, MLA, CLZ = "b1fbf2f0", "01fb0230", "b1fa81f0"
PUSH3, POP3_PC, LDM2, LDRD = "30b5", "30bd", "06c8", "d2e90001"
LITERAL, ADD_TO_R1, ADD_WIDE = "0248", "0144", "01eb0200"
STORE_LR, LOAD_PC, GROW_16 = "4df804ed", "5df804fb", "84b0"


def path(code: str, address: int = 0x0800_0000) -> list[Instruction]:
    decoder, data, out = Decoder(), bytes.fromhex(code), []
    at = 0
    while at < len(data):
        out.append(decoder.decode(data[at : at + 4], address + at))
        at += out[-1].size
    return out


@pytest.mark.parametrize(
    ("code", "cycles"),
    [
        (ADD, 1),
        (CLZ, 1),
        (MLA, 2),
        (UMULL, 5),
        (SMULL, 5),
        (SMLAL, 7),
        (UDIV, 12),
        (LOAD_R0_R1, 2),
        (LOAD_R0_R1 + LOAD_R2_R1, 3),
        (LOAD_R0_R1 + LOAD_R2_R1 + LOAD_R0_R1, 4),
        (LOAD_R0_R1 + LOAD_R2_R0, 4),  # the first result is the second's address
        (LOAD_R0_R1 + NOP + LOAD_R2_R1, 5),
        (STORE_R2_R1, 1),
        (STORE_R2_R1 + LOAD_R0_R1, 3),  # nothing is pipelined behind a store
        (STORE_R2_R1_R3, 2),
        (LOAD_R0_R1 + STORE_R2_R1_R3, 3),
        (ADD_TO_R1 + LOAD_R0_R1, 4),  # the address comes out of the instruction before
        (ADD_TO_R1 + NOP + LOAD_R0_R1, 4),
        (LITERAL, 3),
        (LDM2, 3),
        (LDRD, 3),
        (PUSH3, 4),
    ],
)
def test_one_instruction_costs_what_the_manual_says(code: str, cycles: int) -> None:
    assert path_cost(path(code + RETURN)).cycles == cycles + 3


@pytest.mark.parametrize(("code", "cycles"), [(POP3_PC, 1 + 3 + 2), (LOAD_PC, 5), (RETURN, 3)])
def test_every_way_to_return_refills_the_pipeline(code: str, cycles: int) -> None:
    assert path_cost(path(code)).cycles == cycles


def test_a_branch_to_an_unaligned_wide_instruction_takes_one_cycle_more() -> None:
    branch = path("fee7")  # b to somewhere else
    aligned = path(ADD_WIDE + RETURN, 0x0800_0100)
    unaligned = path(ADD_WIDE + RETURN, 0x0800_0102)
    assert path_cost(branch + unaligned).cycles == path_cost(branch + aligned).cycles + 1


def test_stack_is_followed_through_push_and_subtraction() -> None:
    assert path_cost(path(PUSH3 + GROW_16 + STORE_LR + RETURN)).stack == 12 + 16 + 4


def test_two_wait_states_limit_wide_code_to_one_line_in_three_cycles() -> None:
    """Sixteen wide additions are eight 64-bit lines of three cycles each; the return comes after them."""
    cost = path_cost(path(ADD_WIDE * 16 + RETURN))
    assert cost.cycles == 16 + 3
    # The return is three cycles and the wait for its line, up to two of which lie behind the last addition.
    assert cost.cycles_2ws == pytest.approx(8 * 3 + 5, abs=2)


def test_two_wait_states_hide_behind_narrow_and_slow_code() -> None:
    """Four narrow instructions last longer than their line takes to come; so does one division."""
    for code in (NOP * 32, UDIV * 8):
        cost = path_cost(path(code + RETURN))
        # The first line and the line that the return goes to wait two cycles each.
        assert cost.cycles_2ws - cost.cycles <= 4


def test_a_literal_load_waits_for_the_flash() -> None:
    plain, literal = path_cost(path(UDIV + LOAD_R0_R1 + RETURN)), path_cost(path(UDIV + LITERAL + RETURN))
    assert literal.cycles - plain.cycles == 1
    # One cycle more as without wait states, and two waits.
    assert literal.cycles_2ws - plain.cycles_2ws >= 3


def test_costs_by_blocks_are_those_of_the_whole_path() -> None:
    """Drawn code in blocks, and drawn paths that mostly go on with the next block: entered in many states of flash, CRC
    unit and stack."""
    rng, kinds = random.Random(4), [ADD, UDIV, LITERAL, LOAD_R0_R1, STORE_R2_R1, STORE_R2_R1, ADD_WIDE, PUSH3, GROW_16]
    code = path("".join(rng.choices(kinds, k=120)))
    cuts = [0, *sorted(rng.sample(range(1, 120), 50)), 120]
    blocks = [code[start:end] for start, end in pairwise(cuts)]
    stores = {one.address for one in code if one.name == "str"}
    costs = PathCosts(stores)
    for _ in range(300):
        at, drawn = rng.randrange(len(blocks)), []
        for _ in range(rng.randint(1, 30)):
            drawn.append(blocks[at])
            at = (at + 1) % len(blocks) if rng.random() < 0.8 else rng.randrange(len(blocks))
        assert costs.of(drawn) == path_cost([one for block in drawn for one in block], stores)


ASSEMBLY = """
    .syntax unified
    .thumb
    .globl outer, inner
    .thumb_func
    .type outer, %function
outer:
    push {r4, lr}
    bl inner
    pop {r4, pc}
    .size outer, . - outer
    .thumb_func
    .type inner, %function
inner:
    adds r0, r0, r2
    bx lr
    .size inner, . - inner
    .globl look
    .thumb_func
    .type look, %function
look:
    movw r1, #:lower16:table
    movt r1, #:upper16:table
    nop
    ldr r0, [r1, r0]
    bx lr
    .size look, . - look
    .align 2
    .type table, %object
table:
    .word 7, 8
    .size table, . - table
"""


def test_the_counter_runs_code_and_books_nested_calls(tmp_path: Path) -> None:
    pytest.importorskip("unicorn")
    if shutil.which("arm-none-eabi-gcc") is None:
        pytest.skip("arm-none-eabi-gcc is not installed")
    from plumb.bench.instruction_counter import Counter, Image

    (tmp_path / "two.s").write_text(ASSEMBLY)
    link = ["-nostdlib", "-Wl,-e,outer", "-Wl,-Ttext=0x08000000"]
    command = ["arm-none-eabi-gcc", "-mcpu=cortex-m3", "-mthumb", *link, "two.s", "-o", "two.elf"]
    subprocess.run(command, cwd=tmp_path, check=True)
    counter = Counter(Image(tmp_path / "two.elf"), ["outer", "inner", "look"])
    call = counter.call("outer", 40, 0, 2)
    assert call.result == 42
    assert call.cost.instructions == 5
    assert call.cost.cycles == 3 + 3 + (1 + 3) + (1 + 2 + 2)
    assert call.cost.stack == 8
    inner = counter.profiles["inner"]
    assert (inner.calls, inner.instructions_max, inner.cycles_max) == (1, 2, 4)
    assert {symbol.name for symbol in counter.symbols_of("outer")} == {"outer", "inner"}
    assert counter.call("look", 4).result == 8
    assert {symbol.name for symbol in counter.symbols_of("look")} == {"look", "table"}
    look = counter.profiles["look"]
    assert look.cycles_max == 3 + 2 + 3
    assert look.cycles_2ws_max >= look.cycles_max + 5  # a table in flash waits, and so does the prefetch


SOURCE = """
    static const int squares[4] = {0, 1, 4, 9};
    static inline __attribute__((always_inline)) int kernel(volatile int *at) {
        return *at + squares[*at & 3];
    }
    int twice(volatile int *at) {
        *at = 7;
        int first = kernel(at);
        *at = 2;
        return first + kernel(at);
    }
"""


def test_the_counter_finds_a_kernel_that_was_inlined(tmp_path: Path) -> None:
    """Each place is a call of its own: what it costs there, of the instructions that came from it alone."""
    pytest.importorskip("unicorn")
    pytest.importorskip("elftools")
    if shutil.which("arm-none-eabi-gcc") is None:
        pytest.skip("arm-none-eabi-gcc is not installed")
    from plumb.bench.instruction_counter import Counter, Image
    from plumb.errors import UsageError

    (tmp_path / "two.c").write_text(SOURCE)
    link = ["-nostdlib", "-Wl,-e,twice", "-Wl,-Ttext=0x08000000"]
    compiler = ["arm-none-eabi-gcc", "-mcpu=cortex-m3", "-mthumb", "-O2", "-fno-schedule-insns2"]
    subprocess.run([*compiler, "-g", *link, "two.c", "-o", "two.elf"], cwd=tmp_path, check=True)
    image = Image(tmp_path / "two.elf")
    counter = Counter(image, ["twice", "kernel"])
    call = counter.call("twice", counter.place(bytes(4)))
    assert call.result == (7 + 9) + (2 + 4)
    kernel, whole = counter.profiles["kernel"], counter.profiles["twice"]
    assert (kernel.calls, whole.calls) == (2, 1)
    # Load twice, mask, load from the table: four at least. There are two calls in the whole.
    assert 4 <= kernel.instructions_min <= kernel.instructions_max < whole.instructions_max / 2
    assert kernel.cycles_max < whole.cycles_max / 2
    assert counter.bytes_of("kernel") < image.symbol("twice").size + image.symbol("squares").size
    assert counter.bytes_of("kernel") > image.symbol("squares").size

    with pytest.raises(UsageError, match="neither as a function nor inlined"):
        Counter(image, ["nowhere"])
    subprocess.run(["arm-none-eabi-strip", "--strip-debug", "two.elf"], cwd=tmp_path, check=True)
    with pytest.raises(UsageError, match="no debug information"):
        Counter(Image(tmp_path / "two.elf"), ["kernel"])
