# The C library: kernels, the steps of the systems, and designs from engineering units. It calls nothing but memcpy and
# memset. `cmake --install` puts headers, archive, CMake package and pkg-config file under the prefix.
include(CMakePackageConfigHelpers)
include(GNUInstallDirs)

set(LIBRARY_SOURCES ${CORE_SOURCES} ${PROJECT_SOURCE_DIR}/firmware/library/kernels.c)
list(FILTER LIBRARY_SOURCES EXCLUDE REGEX "/(generated/systems|generated/record_places|core/commutation|core/digest)\\.c$")

add_library(plumb STATIC ${LIBRARY_SOURCES} ${DESIGN_SOURCES})
add_library(plumb::plumb ALIAS plumb)
set_source_files_properties(${DESIGN_SOURCES} PROPERTIES COMPILE_OPTIONS "${DESIGN_OPTIONS}")
target_compile_options(plumb PRIVATE -ffunction-sections -fdata-sections)
target_include_directories(plumb PRIVATE ${CORE_INCLUDES} INTERFACE $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}>)
foreach(folder ${GENERATED_INCLUDE}/include ${PROJECT_SOURCE_DIR}/firmware/include ${SYSTEM_INCLUDES})
    target_include_directories(plumb INTERFACE $<BUILD_INTERFACE:${folder}>)
endforeach()

install(TARGETS plumb EXPORT plumbTargets ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR})
# Public headers; then those generated for this build, and the systems of other folders.
install(DIRECTORY ${PROJECT_SOURCE_DIR}/firmware/include/plumb ${GENERATED_INCLUDE}/include/plumb
        DESTINATION ${CMAKE_INSTALL_INCLUDEDIR} FILES_MATCHING PATTERN "*.h")
foreach(folder ${SYSTEM_INCLUDES})
    get_filename_component(name ${folder} NAME)
    install(FILES ${folder}/${name}.h DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/plumb)
endforeach()

set(package ${CMAKE_INSTALL_LIBDIR}/cmake/plumb)
install(EXPORT plumbTargets FILE plumbConfig.cmake NAMESPACE plumb:: DESTINATION ${package})
write_basic_package_version_file(${CMAKE_CURRENT_BINARY_DIR}/plumbConfigVersion.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${CMAKE_CURRENT_BINARY_DIR}/plumbConfigVersion.cmake DESTINATION ${package})

# The prefix as seen from the file itself, so that an installed tree may be moved.
file(RELATIVE_PATH PKGCONFIG_PREFIX /prefix/${CMAKE_INSTALL_LIBDIR}/pkgconfig /prefix)
string(REGEX REPLACE "/$" "" PKGCONFIG_PREFIX ${PKGCONFIG_PREFIX})
configure_file(${PROJECT_SOURCE_DIR}/firmware/library/plumb.pc.in plumb.pc @ONLY)
install(FILES ${CMAKE_CURRENT_BINARY_DIR}/plumb.pc DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig)
