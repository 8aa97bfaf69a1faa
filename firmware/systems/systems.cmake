# Which systems are built, and from what.
#
# PLUMB_SYSTEMS (names, or the name of an image of host/plumb/spec/images.toml; empty: all there are) says which of them
# the image and the native core have. They are found as folders with a system.toml in host/plumb/systems and in the
# folders of PLUMB_SYSTEM_PATH, a cache variable or the environment's. tools/generate.py writes what is generated into the
# build folder; the C library alone, of the systems of this package, takes the committed files and needs no Python. Sets
# GENERATED_INCLUDE, SYSTEM_NAMES, IMAGE_FLASH_BYTES and IMAGE_RAM_BYTES; and of these systems with those that they stand on
# SYSTEM_SOURCES, SYSTEM_INCLUDES and SYSTEM_SOURCES_FOR_SIZE; and UNUSED_SOURCES, of the parts of a board that they do
# without.
set(PLUMB_SYSTEMS "" CACHE STRING "Systems to build, by name, or an image by name; empty: all there are")
set(PLUMB_SYSTEM_PATH "$ENV{PLUMB_SYSTEM_PATH}" CACHE STRING "Folders that hold folders of further systems")

set(committed ${PROJECT_SOURCE_DIR}/firmware)
file(GLOB found RELATIVE ${PROJECT_SOURCE_DIR}/host/plumb/systems CONFIGURE_DEPENDS
     ${PROJECT_SOURCE_DIR}/host/plumb/systems/*/system.toml)
list(TRANSFORM found REPLACE "/system.toml$" "")
list(SORT found)
include(${committed}/generated/systems.cmake)
if(PLUMB_LIBRARY_ONLY AND PLUMB_SYSTEMS STREQUAL "" AND PLUMB_SYSTEM_PATH STREQUAL "" AND found STREQUAL PLUMB_DECLARED)
    set(GENERATED_INCLUDE ${committed})
else()
    set(GENERATED_INCLUDE ${PROJECT_BINARY_DIR}/systems)
    include(firmware/build_python.cmake)
    file(GLOB_RECURSE declarations CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/host/plumb/*.toml ${PROJECT_SOURCE_DIR}/host/plumb/*.dbc
         ${PROJECT_SOURCE_DIR}/tools/gen*.py)
    foreach(folder ${PLUMB_SYSTEM_PATH})
        file(GLOB further CONFIGURE_DEPENDS ${folder}/*/system.toml)
        list(APPEND declarations ${further})
    endforeach()
    set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${declarations})
    string(REPLACE ";" ":" path "${PLUMB_SYSTEM_PATH}")
    # A flash image holds only the parameters that its systems read; everything else has the whole table, as has a build for
    # QEMU alone (PLUMB_WHOLE) of the systems that the image of all leaves out.
    if(CMAKE_SYSTEM_PROCESSOR STREQUAL "cortex-m3" AND NOT PLUMB_LIBRARY_ONLY AND NOT PLUMB_WHOLE)
        set(for_flash --flash)
    endif()
    # pip builds in a Python of its own and says so in PYTHONPATH: build-system.requires names what the generator needs.
    execute_process(COMMAND ${CMAKE_COMMAND} -E env PLUMB_SYSTEM_PATH=${path}
                            ${Python3_EXECUTABLE} ${PROJECT_SOURCE_DIR}/tools/generate.py --out ${GENERATED_INCLUDE} ${for_flash} "--systems=${PLUMB_SYSTEMS}"
                    RESULT_VARIABLE failed ERROR_VARIABLE why)
    if(failed)
        message(FATAL_ERROR "${why}")
    endif()
    unset(SYSTEM_SOURCES)
    unset(SYSTEM_INCLUDES)
    unset(SYSTEM_SOURCES_FOR_SIZE)
    unset(UNUSED_SOURCES)
    include(${GENERATED_INCLUDE}/generated/systems.cmake)
endif()

# The C of a system is NAME.c, and its parts NAME_*.c beside it. Those with parts are compiled as one unit, so that a part
# costs no call (firmware/systems/parts.h).
foreach(list SYSTEM_SOURCES SYSTEM_SOURCES_FOR_SIZE)
    unset(units)
    foreach(source ${${list}})
        string(REGEX REPLACE "\\.c$" "" stem ${source})
        file(GLOB parts CONFIGURE_DEPENDS ${stem}_*.c)
        if(parts)
            get_filename_component(system ${stem} NAME)
            list(TRANSFORM parts REPLACE "^.+$" "#include \"\\0\"")
            string(REPLACE ";" "\n" parts "#define PLUMB_ONE_UNIT;#include \"${source}\";${parts};")
            set(source ${PROJECT_BINARY_DIR}/units/${system}.c)
            file(CONFIGURE OUTPUT ${source} CONTENT "${parts}" @ONLY)
        endif()
        list(APPEND units ${source})
    endforeach()
    set(${list} ${units})
endforeach()
