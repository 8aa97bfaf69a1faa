# Sets Python3_EXECUTABLE, the Python of the build: the one that was given, else that of the checkout's .venv, which
# `make demo` and `make test` fill with what the checks of an image need, else the one that CMake finds.
if(NOT DEFINED Python3_EXECUTABLE AND EXISTS ${PROJECT_SOURCE_DIR}/.venv/bin/python)
    set(Python3_EXECUTABLE ${PROJECT_SOURCE_DIR}/.venv/bin/python)
endif()
find_package(Python3 3.11 REQUIRED COMPONENTS Interpreter)
