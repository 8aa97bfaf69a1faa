# Cross compiler for the Cortex-M3: gcc-arm-none-eabi of any distribution.
set(CMAKE_SYSTEM_NAME Generic)
set(CMAKE_SYSTEM_PROCESSOR cortex-m3)

find_program(ARM_GCC arm-none-eabi-gcc)
if(NOT ARM_GCC)
    message(FATAL_ERROR "arm-none-eabi-gcc is not installed: run `make demo`, or install gcc-arm-none-eabi, "
                        "or build the `native` preset, which needs no Arm toolchain.")
endif()
set(CMAKE_C_COMPILER ${ARM_GCC})
set(CMAKE_AR ${ARM_GCC}-ar) # which knows objects for optimisation at link time
set(CMAKE_RANLIB ${ARM_GCC}-ranlib)
set(CMAKE_C_FLAGS_INIT "-mcpu=cortex-m3 -mthumb")
set(CMAKE_TRY_COMPILE_TARGET_TYPE STATIC_LIBRARY)
