# Two commands do all the set-up on a fresh Debian or Ubuntu machine: `make demo` and `make test`.
.PHONY: demo test test-fast test-long image native c-tests sanitize fuzz size check-style format docs clean

VENV := .venv/bin

demo:
	@tools/setup.sh demo
	@$(MAKE) --no-print-directory image native
	$(VENV)/plumb demo --out out/demo

# A worker per core; one that has nothing left takes tests from another. A skip that tests/conftest.py does not allow fails.
PYTEST = PLUMB_NO_SKIPS=1 $(VENV)/python -m pytest -n auto --dist worksteal

test:
	@tools/setup.sh test
	@$(MAKE) --no-print-directory image native
	@$(MAKE) --no-print-directory -j2 --output-sync=target check-style sanitize
	@$(SIZE) --against previous
	@$(MAKE) --no-print-directory c-tests
	$(PYTEST)

# Before a commit: all but the sanitizers, the ways to compile the core, and the tests marked slow.
test-fast:
	@tools/setup.sh test
	@$(MAKE) --no-print-directory image native check-style
	ctest --preset native --parallel 2 --exclude-regex '^compile_|^test_store$$'
	$(PYTEST) -m 'not slow'

# The whole campaigns, of which every other run of the tests takes a sample; CI runs them once a week.
LONG_TESTS := $(shell grep -rlE 'support\.campaigns import' tests)
test-long:
	@tools/setup.sh test
	@$(MAKE) --no-print-directory image native
	PLUMB_LONG=1 $(PYTEST) $(LONG_TESTS)

# The flash image, the same core as a QEMU image, and their checks.
image:
	@cmake --preset stm32f103 $(QUIET)
	@cmake --build --preset stm32f103 $(QUIET)

# The C core on this machine: the shared library that Python loads, and the C tests.
native:
	@cmake --preset native $(QUIET)
	@cmake --build --preset native $(QUIET)

c-tests:
	ctest --preset native --parallel 2

# The C tests under AddressSanitizer and UndefinedBehaviorSanitizer.
sanitize:
	@cmake --preset sanitize $(QUIET)
	@cmake --build --preset sanitize $(QUIET)
	ctest --preset sanitize --parallel 2

# libFuzzer on the codec and on the whole session, FUZZ_S seconds each (clang). Inputs that are found stay in build/fuzz/found.
FUZZ_S ?= 60
FUZZ := build/fuzz/tests/fuzz
fuzz:
	@cmake --preset fuzz $(QUIET)
	@cmake --build --preset fuzz $(QUIET)
	@mkdir -p build/fuzz/found/slcan build/fuzz/found/session
	@for target in slcan session; do \
	    $(FUZZ)/fuzz_$$target -max_total_time=$(FUZZ_S) -max_len=1024 -timeout=20 -print_final_stats=1 \
	        -artifact_prefix=build/fuzz/found/$$target- build/fuzz/found/$$target $(FUZZ)/corpus/$$target || exit 1; done

# Flash, RAM and stack by module and function, and what differs from the commit before.
SIZE = $(VENV)/python tools/size_table.py build/stm32f103/firmware.elf
size: image
	@$(SIZE) --functions
	@$(SIZE) --against previous

C_FILES = $(shell git ls-files '*.c' '*.h')
check-style:
	$(VENV)/ruff check --no-cache host tools tests examples
	$(VENV)/ruff format --check host tools tests examples
	$(VENV)/mypy
	$(VENV)/clang-format --dry-run -Werror $(C_FILES)

format:
	$(VENV)/ruff check --fix host tools tests examples
	$(VENV)/ruff format host tools tests examples
	$(VENV)/clang-format -i $(C_FILES)

# The documentation site, in out/site; reading it needs no network.
docs:
	@tools/setup.sh docs
	NO_MKDOCS_2_WARNING=1 $(VENV)/mkdocs build --strict

clean:
	rm -rf build out
