# Two commands do all the set-up on a fresh Debian or Ubuntu machine: `make demo` and `make test`.
.PHONY: demo test image native size check-style format clean

VENV := .venv/bin

demo:
	@tools/setup.sh demo
	@$(MAKE) --no-print-directory image native
	$(VENV)/plumb demo --out out/demo

test:
	@tools/setup.sh test
	@$(MAKE) --no-print-directory image native check-style
	@$(SIZE) --against previous
	cmake --preset sanitize
	cmake --build --preset sanitize
	ctest --preset sanitize --parallel 2
	ctest --preset native --parallel 2
	$(VENV)/python -m pytest

# The flash image, the same core as a QEMU image, and their checks.
image:
	@cmake --preset stm32f103 $(QUIET)
	@cmake --build --preset stm32f103 $(QUIET)

# The C core on this machine: the shared library that Python loads, and the C tests.
native:
	@cmake --preset native $(QUIET)
	@cmake --build --preset native $(QUIET)

# Flash, RAM and stack by module and function, and what differs from the commit before.
SIZE = $(VENV)/python tools/size_table.py build/stm32f103/firmware.elf
size: image
	@$(SIZE) --functions
	@$(SIZE) --against previous

C_FILES = $(shell git ls-files '*.c' '*.h')
check-style:
	$(VENV)/ruff check --no-cache host tools tests
	$(VENV)/ruff format --check host tools tests
	$(VENV)/mypy
	$(VENV)/clang-format --dry-run -Werror $(C_FILES)

format:
	$(VENV)/ruff check --fix host tools tests
	$(VENV)/ruff format host tools tests
	$(VENV)/clang-format -i $(C_FILES)

clean:
	rm -rf build out
