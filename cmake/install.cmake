# What `cmake --install` puts where. The result may be moved: the command, libsaltus.so, the CMake package and saltus.pc
# find everything relative to themselves.
include(CMakePackageConfigHelpers)

if(TARGET saltus-cli)
  install(TARGETS saltus-cli RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR})
  # What completes command lines, made by the command itself from its tables.
  if(NOT CMAKE_CROSSCOMPILING)
    set(COMPLETIONS ${CMAKE_BINARY_DIR}/completions)
    file(MAKE_DIRECTORY ${COMPLETIONS})
    add_custom_command(TARGET saltus-cli POST_BUILD
      COMMAND saltus-cli completions bash > ${COMPLETIONS}/saltus
      COMMAND saltus-cli completions zsh > ${COMPLETIONS}/_saltus
      COMMAND saltus-cli completions fish > ${COMPLETIONS}/saltus.fish
      BYPRODUCTS ${COMPLETIONS}/saltus ${COMPLETIONS}/_saltus ${COMPLETIONS}/saltus.fish)
    install(FILES ${COMPLETIONS}/saltus DESTINATION ${CMAKE_INSTALL_DATADIR}/bash-completion/completions)
    install(FILES ${COMPLETIONS}/_saltus DESTINATION ${CMAKE_INSTALL_DATADIR}/zsh/site-functions)
    install(FILES ${COMPLETIONS}/saltus.fish DESTINATION ${CMAKE_INSTALL_DATADIR}/fish/vendor_completions.d)
  endif()
endif()
install(TARGETS saltus-static saltus-shared EXPORT saltus ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR} LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR}
  INCLUDES DESTINATION ${CMAKE_INSTALL_INCLUDEDIR})
if(LLVM_LINKED)
  install(PROGRAMS ${LLVM_LINKED} DESTINATION ${CMAKE_INSTALL_LIBDIR}/saltus)
endif()
install(DIRECTORY include/saltus DESTINATION ${CMAKE_INSTALL_INCLUDEDIR} FILES_MATCHING PATTERN "*.h" PATTERN "*.def")
install(DIRECTORY stdlib/ DESTINATION ${SALTUS_STDLIB_DIR} FILES_MATCHING PATTERN "*.salt")
foreach(section 1 3)
  file(GLOB PAGES CONFIGURE_DEPENDS ${CMAKE_SOURCE_DIR}/docs/man/*.${section})
  install(FILES ${PAGES} DESTINATION ${CMAKE_INSTALL_MANDIR}/man${section})
endforeach()
install(FILES LICENSE DESTINATION ${CMAKE_INSTALL_DOCDIR})

# The Python package, where the Python that is found looks below the prefix (Debian: lib/python3/dist-packages of /usr,
# lib/python3.11/dist-packages of /usr/local). Not installed where there is none.
find_package(Python3 COMPONENTS Interpreter)
if(Python3_FOUND AND NOT DEFINED SALTUS_PYTHON_DIR)
  execute_process(COMMAND ${Python3_EXECUTABLE} ${CMAKE_SOURCE_DIR}/bindings/python/where.py ${CMAKE_INSTALL_PREFIX}
    OUTPUT_VARIABLE PYTHON_DIR OUTPUT_STRIP_TRAILING_WHITESPACE)
endif()
set(SALTUS_PYTHON_DIR "${PYTHON_DIR}" CACHE STRING "where the Python package goes, below the prefix; empty: nowhere")
if(SALTUS_PYTHON_DIR)
  install(DIRECTORY bindings/python/saltus DESTINATION ${SALTUS_PYTHON_DIR} FILES_MATCHING PATTERN "*.py" PATTERN "py.typed" PATTERN "__pycache__" EXCLUDE)
endif()

set(PACKAGE_DIR ${CMAKE_INSTALL_LIBDIR}/cmake/saltus)
install(EXPORT saltus NAMESPACE saltus:: FILE saltusTargets.cmake DESTINATION ${PACKAGE_DIR})
configure_package_config_file(${CMAKE_SOURCE_DIR}/cmake/saltusConfig.cmake.in ${CMAKE_BINARY_DIR}/saltusConfig.cmake
  INSTALL_DESTINATION ${PACKAGE_DIR})
write_basic_package_version_file(${CMAKE_BINARY_DIR}/saltusConfigVersion.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${CMAKE_BINARY_DIR}/saltusConfig.cmake ${CMAKE_BINARY_DIR}/saltusConfigVersion.cmake DESTINATION ${PACKAGE_DIR})

file(RELATIVE_PATH PC_TO_PREFIX /prefix/${CMAKE_INSTALL_LIBDIR}/pkgconfig /prefix)
foreach(name saltus saltus-shared)
  configure_file(${CMAKE_SOURCE_DIR}/cmake/${name}.pc.in ${CMAKE_BINARY_DIR}/${name}.pc @ONLY)
  install(FILES ${CMAKE_BINARY_DIR}/${name}.pc DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig)
endforeach()

configure_file(${CMAKE_SOURCE_DIR}/cmake/after_install.cmake.in ${CMAKE_BINARY_DIR}/after_install.cmake @ONLY)
install(SCRIPT ${CMAKE_BINARY_DIR}/after_install.cmake)
