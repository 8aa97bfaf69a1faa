"""The check of the linked image finds what must not be there, and bounds the stack."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from plumb.errors import UsageError
from plumb.flash.call_graph import CallGraph
from plumb.flash.elf import Elf

ROOT = Path(__file__).parents[2]
CHECK = ROOT / "tools/check_elf.py"
IMAGE = ROOT / "build/stm32f103/firmware.elf"
LIMITS = "flash_budget = 64K; ram_budget = 20K; stack_bytes = 4K; "

pytestmark = pytest.mark.skipif(shutil.which("arm-none-eabi-gcc") is None, reason="arm-none-eabi-gcc is not installed")

FRAME = """
void reset(void);
void handler(void);
__attribute__((section(".vectors"), used)) void (*const vectors[4])(void) = {0, reset, handler, handler};
volatile int x;
volatile char *volatile seen;
%s
void handler(void) { x++; }
void reset(void) { x = work(x); for (;;) {} }
"""
GOOD = "static int __attribute__((noinline)) work(int a) { return a * 3; }"


def build(folder: Path, work: str) -> Path:
    (folder / "a.c").write_text(FRAME % work)
    (folder / "a.ld").write_text(
        LIMITS + "SECTIONS { . = 0x08000000; .text : { KEEP(*(.vectors)) *(.text* .rodata*) }"
        " .ARM.exidx : { *(.ARM.exidx*) } . = 0x20000000; .data : { *(.data*) } .bss : { *(.bss* COMMON) } }"
    )
    return link(folder)


def link(folder: Path) -> Path:
    command = ["arm-none-eabi-gcc", "-mcpu=cortex-m3", "-mthumb", "-O2", "-nostartfiles", "--specs=nosys.specs"]
    command += ["-Wl,-e,reset", "-Wl,--defsym=end=0x20001000", "-Wl,--no-warn-rwx-segments", "-T", "a.ld"]
    subprocess.run([*command, "a.c", "-o", "a.elf"], cwd=folder, check=True, capture_output=True)
    return folder / "a.elf"


def check(image: Path, *options: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(CHECK), str(image), *options]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_a_good_image_passes(tmp_path: Path) -> None:
    result = check(build(tmp_path, GOOD), "--flash", "1000", "--ram", "1000")
    assert result.returncode == 0, result.stderr
    assert "no soft float" in result.stdout


def test_stm_to_sp_leaves_the_stack_pointer(tmp_path: Path) -> None:
    work = 'static int work(int a) { int b[4]; __asm volatile("stmia sp, {r0, r1}" : "=m"(b)); return b[a & 3]; }'
    result = check(build(tmp_path, work))
    assert result.returncode == 0, result.stderr


@pytest.mark.parametrize(
    ("work", "sentence"),
    [
        ("static int work(int a) { return (int)((float)a * 1.5f); }", "contains soft float"),
        ("static int work(int a) { return (int)((double)a + 1.5); }", "contains soft float"),
        ("static int work(int a) { return (int)(1000000000000ULL / (unsigned)a); }", "contains library division"),
        ("#include <stdlib.h>\nstatic int work(int a) { seen = malloc(a); return 0; }", "contains the heap"),
        (
            "int __attribute__((noinline)) work(int a) { return a < 2 ? a : work(a - 1) * work(a - 2); }",
            "recurses: work",
        ),
        ("int (*volatile f)(int);\nstatic int work(int a) { return f(a) + 1; }", "through a pointer"),
        ("static int work(int a) { char b[a]; seen = b; return b[a / 2] + *seen; }", "by an unknown amount"),
    ],
)
def test_each_broken_promise_is_named(tmp_path: Path, work: str, sentence: str) -> None:
    result = check(build(tmp_path, work))
    assert result.returncode == 1
    assert sentence in result.stderr


@pytest.mark.parametrize(("option", "sentence"), [("--flash", "of flash"), ("--ram", "of RAM"), ("--stack", "stack")])
def test_a_budget_that_is_exceeded_is_named(tmp_path: Path, option: str, sentence: str) -> None:
    result = check(build(tmp_path, GOOD), option, "4")
    assert result.returncode == 1
    assert sentence in result.stderr


def test_the_limits_of_the_linker_script_hold_without_options(tmp_path: Path) -> None:
    for name, sentence in (("flash_budget", "of flash"), ("ram_budget", "of RAM"), ("stack_bytes", "of stack")):
        script = build(tmp_path, GOOD).with_name("a.ld")
        script.write_text(re.sub(rf"{name} = \w+;", f"{name} = 4;", script.read_text()))
        result = check(link(tmp_path))
        assert result.returncode == 1 and sentence in result.stderr
    script.write_text(script.read_text().replace(LIMITS.split(";")[0], ""))
    script.write_text(script.read_text().removeprefix(";"))
    result = check(link(tmp_path))
    assert result.returncode == 2 and "no symbol flash_budget" in result.stderr


def test_worst_stack_is_call_chain_plus_handler_plus_fault(tmp_path: Path) -> None:
    work = """
    int __attribute__((noinline)) deep(int a) { volatile char b[200]; b[a & 127] = 1; seen = b; return b[0]; }
    int __attribute__((noinline)) shallow(int a) { volatile char b[40]; b[a & 31] = 1; seen = b; return b[0]; }
    static int work(int a) { return deep(a) + shallow(a); }
    """
    image = build(tmp_path, work)
    graph = CallGraph(image)
    functions = {f.name: f for f in graph.functions.values()}
    assert functions["deep"].depth_bytes >= 200
    assert functions["shallow"].depth_bytes >= 40
    reset = functions["reset"]
    assert graph.stack_bytes(reset.address) == reset.depth_bytes + functions["deep"].depth_bytes
    handlers = 36 + functions["handler"].depth_bytes + 36
    assert graph.worst_stack_bytes() == graph.stack_bytes(reset.address) + handlers


def test_a_tail_call_and_a_jump_table_lead_on(tmp_path: Path) -> None:
    """`work` jumps to `middle`, which goes to `deep` only from inside a jump table."""
    work = """
    int __attribute__((noinline)) deep(int a) { volatile char b[300]; b[a & 127] = 1; seen = b; return b[0]; }
    int __attribute__((noinline)) middle(int a) {
        switch (a) {
        case 0: x = 5; break; case 1: x *= 7; break; case 2: x -= 2; break; case 3: x /= 3; break;
        case 4: return deep(x) + 1; case 5: x ^= 77; break; case 6: x = -x; break; case 7: x <<= 3; break;
        }
        return x;
    }
    int __attribute__((noinline)) work(int a) { x += a; return middle(a & 7); }
    """
    image = build(tmp_path, work)
    listing = subprocess.run(["arm-none-eabi-objdump", "-d", str(image)], capture_output=True, text=True, check=True)
    assert "tbb" in listing.stdout or "tbh" in listing.stdout
    graph = CallGraph(image)
    functions = {f.name: f for f in graph.functions.values()}
    assert functions["work"].calls == {functions["middle"].address: 0}
    assert functions["deep"].address in functions["middle"].calls
    assert graph.stack_bytes(functions["work"].address) >= 300 + functions["middle"].depth_bytes


def test_bytes_of_a_table_are_not_read_as_code(tmp_path: Path) -> None:
    """Behind the code, where mapping symbols end with the last function, and between the instructions of one: 0xe400
    would be a branch back beyond the image, 0xb500 a push, 0x4780 a call through a register."""
    work = """
    const unsigned short table[6] = {0xe400, 0xd0c0, 0xb500, 0x4780, 0xf7ff, 0xbffe};
    __attribute__((naked, noinline)) static int inside(int a) {
        __asm volatile("b 1f\\n .short 0xe400, 0xb500, 0x4780, 0xf7ff\\n 1: bx lr");
    }
    int __attribute__((noinline)) work(int a) { return inside(a) + table[a & 3]; }
    """
    image = build(tmp_path, work)
    functions = {f.name: f for f in CallGraph(image).functions.values()}
    assert "table" in Elf(image).symbols and "table" not in functions
    assert not functions["inside"].calls and not functions["inside"].indirect and not functions["inside"].depth_bytes
    result = check(image)
    assert result.returncode == 0, result.stderr


def test_an_instruction_that_an_it_block_may_skip_does_not_end_a_path(tmp_path: Path) -> None:
    """The deepest stack lies behind a return that is taken for zero alone; what was popped for it stays counted."""
    work = """
    __attribute__((naked, noinline)) int work(int a) {
        __asm volatile("push {r4, lr}\\n cmp r0, #0\\n it eq\\n popeq {r4, pc}\\n"
                       "sub sp, #64\\n add sp, #64\\n pop {r4, pc}");
    }
    """
    functions = {f.name: f for f in CallGraph(build(tmp_path, work)).functions.values()}
    assert functions["work"].depth_bytes == 8 + 64


def test_the_reserved_stack_is_not_counted_as_data(tmp_path: Path) -> None:
    plain = Elf(build(tmp_path, GOOD)).ram_bytes
    reserve = 'char reserve[512] __attribute__((section(".bss.stack"), used));'
    script = build(tmp_path, GOOD + reserve).with_name("a.ld")
    assert Elf(tmp_path / "a.elf").ram_bytes == plain + 512
    script.write_text(script.read_text().replace(".bss :", ".stack (NOLOAD) : { *(.bss.stack) } .bss :"))
    link(tmp_path)
    assert Elf(tmp_path / "a.elf").ram_bytes == plain


def test_files_that_are_no_image_are_refused_in_one_sentence(tmp_path: Path) -> None:
    image = build(tmp_path, GOOD)
    (tmp_path / "short.elf").write_bytes(image.read_bytes()[:100])
    (tmp_path / "text.elf").write_text("not an image")
    subprocess.run(["arm-none-eabi-strip", "-o", str(tmp_path / "bare.elf"), str(image)], check=True)
    for name in ("short.elf", "text.elf", "missing.elf", "bare.elf"):
        result = check(tmp_path / name)
        assert result.returncode == 2
        assert len(result.stderr.splitlines()) == 1
    with pytest.raises(UsageError):
        Elf(tmp_path / "text.elf")


def test_the_flash_image_keeps_its_promises() -> None:
    if not IMAGE.is_file():
        pytest.skip("there is no flash image; build it with make image")
    result = check(IMAGE)
    assert result.returncode == 0, result.stderr
