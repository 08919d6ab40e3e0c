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
install(DIRECTORY include/saltus DESTINATION ${CMAKE_INSTALL_INCLUDEDIR} FILES_MATCHING PATTERN "*.h" PATTERN "*.def")
install(DIRECTORY stdlib/ DESTINATION ${CMAKE_INSTALL_DATADIR}/saltus/stdlib FILES_MATCHING PATTERN "*.salt")
install(FILES docs/saltus.1 DESTINATION ${CMAKE_INSTALL_MANDIR}/man1)
install(FILES LICENSE DESTINATION ${CMAKE_INSTALL_DOCDIR})

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
