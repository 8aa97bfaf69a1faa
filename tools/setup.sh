#!/bin/sh
# Installs what is missing on a Debian or Ubuntu machine, and nothing when nothing is.
# usage: tools/setup.sh demo|test|release|docs
# Packages come from apt (with sudo when not root); Python packages go into .venv, never into the system.
set -eu
cd "$(dirname "$0")/.."
purpose=${1:?usage: tools/setup.sh demo|test|release|docs}

missing=""
need() { # command, package
    command -v "$1" >/dev/null 2>&1 || missing="$missing $2"
}
need gcc gcc
need cmake cmake
need ninja ninja-build
need arm-none-eabi-gcc gcc-arm-none-eabi
need qemu-system-arm qemu-system-arm
# The C library headers of the cross compiler are a package of their own.
[ -e /usr/include/newlib/string.h ] || [ -e /usr/lib/arm-none-eabi/include/string.h ] ||
    missing="$missing libnewlib-arm-none-eabi"
if [ "$purpose" = test ]; then
    need clang clang
    # Branches that the golden vectors take are counted with clang's coverage and the profile runtime of its version.
    need llvm-cov llvm
    runtime=libclang-rt-dev
    if command -v clang >/dev/null 2>&1; then
        major=$(clang -dumpversion)
        runtime=libclang-rt-${major%%.*}-dev
    fi
    printf 'int main(void){return 0;}' | clang -fprofile-instr-generate -x c - -o /dev/null 2>/dev/null ||
        missing="$missing $runtime"
    # Published filters in C++ whose cycles are counted.
    [ -e /usr/share/doc/libstdc++-arm-none-eabi-newlib ] || missing="$missing libstdc++-arm-none-eabi-newlib"
    # Programs built against the installed C library.
    need g++ g++
    need pkg-config pkg-config
    # The flashing tools that plumb drives, or that should get on with its simulated bootloader.
    need openocd openocd
    need stm32flash stm32flash
    # The debugger that stops the simulated chip.
    need gdb-multiarch gdb-multiarch
    # Shells whose completion is tried; bash is there.
    need zsh zsh
    need fish fish
    # The browser that the tests of the cockpit drive.
    need chromium chromium
    # 32-bit builds of the core need the 32-bit C library.
    printf 'int main(void){return 0;}' | gcc -m32 -x c - -o /dev/null 2>/dev/null || missing="$missing gcc-multilib"
fi

python=""
for candidate in python3 python3.13 python3.12 python3.11; do
    if command -v "$candidate" >/dev/null 2>&1 &&
        "$candidate" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
        python=$candidate
        break
    fi
done
[ -n "$python" ] || { missing="$missing python3"; python=python3; }
"$python" -c 'import venv, ensurepip' >/dev/null 2>&1 || missing="$missing python3-venv"

if [ -n "$missing" ]; then
    command -v apt-get >/dev/null 2>&1 || {
        echo "plumb: this machine has no apt-get; please install the equivalents of:$missing" >&2
        exit 2
    }
    sudo=""
    if [ "$(id -u)" -ne 0 ]; then
        command -v sudo >/dev/null 2>&1 || {
            echo "plumb: please install as root:$missing" >&2
            exit 2
        }
        sudo=sudo
    fi
    echo "plumb: installing$missing"
    $sudo apt-get update -qq
    # shellcheck disable=SC2086  # a list of package names
    $sudo env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $missing >/dev/null
fi

# One stamp per purpose holds the project file it was installed from, and the modules that the install knows by path; when
# that differs, install again.
stamp=.venv/plumb-$purpose.stamp
wanted() {
    cat pyproject.toml
    find host/plumb -name '*.py' | sort
}
if ! wanted | cmp -s - "$stamp"; then
    extras=virtual,bench,flash,report,monitor,cockpit
    [ "$purpose" = test ] && extras=dev
    [ "$purpose" = release ] && extras=release
    [ "$purpose" = docs ] && extras=docs
    [ -x .venv/bin/python ] || "$python" -m venv .venv
    echo "plumb: installing Python packages into .venv"
    .venv/bin/python -m pip install -q --disable-pip-version-check --upgrade pip
    # The distribution was called plumb before it was plumb-imu; both at once would register everything twice.
    .venv/bin/python -m pip uninstall -q -y plumb 2>/dev/null || true
    .venv/bin/python -m pip install -q --disable-pip-version-check -e ".[$extras]"
    wanted >"$stamp"
fi
