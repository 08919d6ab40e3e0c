# `format`, `check-format` and `tidy`: only where the tools are (bootstrap tools), and never part of a build.
find_program(CLANG_TIDY NAMES run-clang-tidy-${SALTUS_LLVM} run-clang-tidy) # on all cores
find_program(SALTUS_CLANG_FORMAT NAMES clang-format-${SALTUS_LLVM}) # no other version: each breaks lines a little differently
file(GLOB_RECURSE TOOL_SOURCES CONFIGURE_DEPENDS ${CMAKE_SOURCE_DIR}/compiler/*.c ${CMAKE_SOURCE_DIR}/runtime/*.c ${CMAKE_SOURCE_DIR}/cli/*.c
  ${CMAKE_SOURCE_DIR}/tests/*.c)
if(CLANG_TIDY)
  add_custom_target(tidy COMMAND ${CLANG_TIDY} -quiet -p ${CMAKE_BINARY_DIR} "^${CMAKE_SOURCE_DIR}/(compiler|runtime|cli|tests)/" USES_TERMINAL)
endif()
if(SALTUS_CLANG_FORMAT)
  set(CHECK_FORMAT ${SALTUS_CLANG_FORMAT} --dry-run -Werror ${TOOL_SOURCES})
  add_custom_target(format COMMAND ${SALTUS_CLANG_FORMAT} -i ${TOOL_SOURCES} WORKING_DIRECTORY ${CMAKE_SOURCE_DIR} USES_TERMINAL)
  add_custom_target(check-format COMMAND ${CHECK_FORMAT} WORKING_DIRECTORY ${CMAKE_SOURCE_DIR} USES_TERMINAL)
else()
  set(CHECK_FORMAT ${CMAKE_COMMAND} -E echo "skipped: clang-format-${SALTUS_LLVM} is not installed")
endif()
if(SALTUS_TESTS)
  add_test(NAME tools.format COMMAND ${CHECK_FORMAT} WORKING_DIRECTORY ${CMAKE_SOURCE_DIR})
  set_tests_properties(tools.format PROPERTIES SKIP_REGULAR_EXPRESSION "^skipped:")
endif()
