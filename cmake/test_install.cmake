# Somebody else's project uses what is installed.
if(TARGET saltus-cli AND NOT SALTUS_SANITIZE)
  add_test(NAME install.consumer COMMAND ${CMAKE_SOURCE_DIR}/tests/install/run.sh ${CMAKE_BINARY_DIR} ${CMAKE_C_COMPILER})
  set_tests_properties(install.consumer PROPERTIES TIMEOUT 3600)
endif()
