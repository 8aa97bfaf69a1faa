# The flash image for the STM32F103 (firmware.elf, .bin, .hex), and the core alone as a program for QEMU.
include(firmware/build_python.cmake)

# The core is built for speed, everything around it for size. What follows -O2 was chosen by `plumb bench`: no literal
# pools (their loads wait for the flash), and instructions left in the order written, which has loads side by side (a
# load behind a load takes one cycle, not two); registers renamed afterwards.
target_compile_options(plumb_core PRIVATE -O2
    -mslow-flash-data -fno-schedule-insns -fno-schedule-insns2 -fno-peephole2 -fno-tree-reassoc -fno-tree-pre
    -frename-registers -fweb)
# Branches in place of long straight code: here the compiler's order is the better one.
set_source_files_properties(firmware/core/plausibility.c PROPERTIES COMPILE_OPTIONS
    "-fschedule-insns2;-ftree-pre;-fno-rename-registers;-fno-web")
# Link and port are optimised as one program. A large function with one caller stays a function, so that its locals do
# not lie below its caller's on the stack. The core is left out: bench measures its functions by name.
set(AS_ONE_PROGRAM -flto -fno-inline-functions-called-once -fno-ipa-cp -fno-move-loop-invariants)
set(ALONE "-fno-lto;-finline-functions-called-once;-fipa-cp")
# Statics of a file side by side: one address reaches them all (10 % of the port).
target_compile_options(plumb_link PRIVATE -Os -fno-data-sections ${AS_ONE_PROGRAM})
# What touches every byte of every frame is built for speed: a quarter of a step's instructions are in it.
set_source_files_properties(firmware/link/slcan.c firmware/link/e2e.c PROPERTIES COMPILE_OPTIONS -O2)
# What no system with a budget of cycles uses, and the systems that ask for it (optimise = "size").
set_source_files_properties(firmware/core/fixed.c firmware/core/prefilter.c firmware/core/quaternion.c firmware/core/takeoff.c
    ${SYSTEM_SOURCES_FOR_SIZE} PROPERTIES COMPILE_OPTIONS "-Os;-mno-slow-flash-data")
# The switch between systems needs one register beside the four arguments: r12, which nobody has to save.
set_source_files_properties(${GENERATED_INCLUDE}/generated/systems.c PROPERTIES COMPILE_OPTIONS
    "-ffixed-r4;-ffixed-r5;-ffixed-r6;-ffixed-r7")

# Which commit this is: looked up in every build, so that the image never carries yesterday's name.
set(BUILD_ID ${CMAKE_BINARY_DIR}/generated/build_id.h)
add_custom_target(build_id BYPRODUCTS ${BUILD_ID}
    COMMAND ${CMAKE_COMMAND} -DSOURCE=${CMAKE_SOURCE_DIR} -DOUTPUT=${BUILD_ID}
            -P ${CMAKE_SOURCE_DIR}/firmware/ports/stm32f103/build_id.cmake)

file(GLOB PORT_SOURCES CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/firmware/ports/stm32f103/*.c)
foreach(source ${UNUSED_SOURCES})
    list(REMOVE_ITEM PORT_SOURCES ${source})
endforeach()
set(LINKER_SCRIPT ${CMAKE_SOURCE_DIR}/firmware/ports/stm32f103/stm32f103.ld)
add_executable(firmware firmware/app/loop.c firmware/app/loop_links.c ${PORT_SOURCES} ${GENERATED_INCLUDE}/generated/chips.c)
add_dependencies(firmware build_id)
set_target_properties(firmware PROPERTIES SUFFIX .elf LINK_DEPENDS ${LINKER_SCRIPT})
target_include_directories(firmware PRIVATE ${CMAKE_BINARY_DIR}/generated firmware/ports/stm32f103)
target_compile_options(firmware PRIVATE -Os -fno-data-sections ${AS_ONE_PROGRAM})
# A loop that copies must not become a call of memcpy where memcpy is written.
set_source_files_properties(firmware/ports/stm32f103/memory.c PROPERTIES COMPILE_OPTIONS "-O2;-fno-tree-loop-distribute-patterns;${ALONE}")
# What assembler or the processor enters, what bench measures by name, and where tests stop the loop.
foreach(file startup faults crc guard idle pwm)
    set_source_files_properties(firmware/ports/stm32f103/${file}.c PROPERTIES COMPILE_OPTIONS "${ALONE}")
endforeach()
target_link_libraries(firmware PRIVATE plumb_link plumb_core)
target_link_options(firmware PRIVATE -Os -fno-data-sections ${AS_ONE_PROGRAM} -ffile-prefix-map=${CMAKE_SOURCE_DIR}=.
    -nostartfiles --specs=nano.specs -T ${LINKER_SCRIPT}
    -Wl,--defsym=flash_budget=${IMAGE_FLASH_BYTES} -Wl,--defsym=ram_budget=${IMAGE_RAM_BYTES}
    -Wl,--gc-sections -Wl,-Map,${CMAKE_BINARY_DIR}/firmware.map -Wl,--fatal-warnings -Wl,--build-id=none)
# What does not keep its promises, or its budget, does not become an image: without firmware.bin, and with an ELF file that
# no tool takes for one, because its checksum is missing. As firmware.bin is an output of the link, it is linked again then.
add_custom_command(TARGET firmware POST_BUILD VERBATIM BYPRODUCTS ${CMAKE_BINARY_DIR}/firmware.bin ${CMAKE_BINARY_DIR}/firmware.hex
    COMMAND ${CMAKE_COMMAND} -E rm -f ${CMAKE_BINARY_DIR}/firmware.bin ${CMAKE_BINARY_DIR}/firmware.hex
    COMMAND ${Python3_EXECUTABLE} ${CMAKE_SOURCE_DIR}/tools/check_elf.py $<TARGET_FILE:firmware>
    COMMAND ${Python3_EXECUTABLE} ${CMAKE_SOURCE_DIR}/tools/size_table.py $<TARGET_FILE:firmware>
    COMMAND ${Python3_EXECUTABLE} ${CMAKE_SOURCE_DIR}/tools/finish_image.py $<TARGET_FILE:firmware>)

# cmake --build --preset stm32f103 --target flash: builds what is stale, then writes it to the board at PLUMB_PORT.
set(PLUMB_PORT /dev/ttyUSB0 CACHE STRING "Serial port of the board, for the target flash")
find_program(PLUMB_COMMAND plumb HINTS ${CMAKE_SOURCE_DIR}/.venv/bin)
if(PLUMB_COMMAND)
    add_custom_target(flash USES_TERMINAL VERBATIM DEPENDS firmware
        COMMAND ${PLUMB_COMMAND} flash --port ${PLUMB_PORT} --image $<TARGET_FILE_DIR:firmware>/firmware.bin)
endif()

file(GLOB QEMU_SOURCES CONFIGURE_DEPENDS firmware/ports/qemu/*.c)
set(QEMU_SCRIPT ${CMAKE_SOURCE_DIR}/firmware/ports/qemu/qemu.ld)
add_executable(plumb_qemu ${QEMU_SOURCES})
set_target_properties(plumb_qemu PROPERTIES SUFFIX .elf LINK_DEPENDS ${QEMU_SCRIPT})
target_compile_options(plumb_qemu PRIVATE -O2)
target_link_libraries(plumb_qemu PRIVATE plumb_core)
target_link_options(plumb_qemu PRIVATE -nostartfiles --specs=nano.specs -T ${QEMU_SCRIPT} -Wl,--gc-sections)
add_subdirectory(firmware/ports/qemu)
