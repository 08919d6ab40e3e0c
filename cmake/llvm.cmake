# A library with what we call of LLVM, linked from its archives where they are installed. libLLVM.so has every target
# and what each of them needs, all of which a cold start loads; this one has 98 000 places to relocate instead of
# 330 000, no libraries beside it but zlib, zstd and that of C++, and is loaded in a quarter of the time. The code is
# the same. It is linked here and not in the build, so that where that cannot be done the shared library simply stays.
option(SALTUS_LLVM_LINKED "link a smaller LLVM of our own from its archives, if they are installed" ON)

set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS compiler/back/cpu/llvm_api.def)
file(READ compiler/back/cpu/llvm_api.def text)
string(REGEX MATCHALL "FN\\([A-Za-z0-9]+\\)" names "${text}")
list(TRANSFORM names REPLACE "FN\\((.*)\\)" "LLVM\\1")
list(APPEND names _ZN4llvm31install_bad_alloc_error_handlerEPFvPvPKcbES0_) # guard.c
execute_process(COMMAND ${LLVM_CONFIG} --link-static --libs x86codegen passes core OUTPUT_VARIABLE LLVM_ARCHIVES
  OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET RESULT_VARIABLE missing)
execute_process(COMMAND ${LLVM_CONFIG} --version OUTPUT_VARIABLE LLVM_NUMBER OUTPUT_STRIP_TRAILING_WHITESPACE)
find_library(ZSTD_LIBRARY NAMES zstd libzstd.so.1)
string(SHA256 contents "${LLVM_NUMBER} ${LLVM_ARCHIVES} ${names} ${LLVM_LIBRARY_FILE}")
string(SUBSTRING ${contents} 0 8 contents)
set(LLVM_LINKED ${CMAKE_BINARY_DIR}/lib/libLLVM-${LLVM_NUMBER}-saltus-${contents}.so) # another list of names is another file

if(NOT SALTUS_LLVM_LINKED OR missing OR NOT ZSTD_LIBRARY OR NOT CMAKE_SYSTEM_PROCESSOR MATCHES "x86_64|AMD64")
  set(LLVM_LINKED "")
elseif(NOT EXISTS ${LLVM_LINKED})
  list(JOIN names ";\n    " lines)
  file(CONFIGURE OUTPUT ${CMAKE_BINARY_DIR}/generated/llvm.map CONTENT "{\nglobal:\n    ${lines};\nlocal:\n    *;\n};\n")
  list(TRANSFORM names PREPEND "-Wl,-u,")
  separate_arguments(archives UNIX_COMMAND "${LLVM_ARCHIVES}")
  file(MAKE_DIRECTORY ${CMAKE_BINARY_DIR}/lib)
  file(GLOB before ${CMAKE_BINARY_DIR}/lib/libLLVM-*-saltus-*) # of other names; who runs keeps what is open
  file(REMOVE ${LLVM_LINKED}.new ${before})
  execute_process(RESULT_VARIABLE failed OUTPUT_QUIET ERROR_QUIET
    COMMAND ${CMAKE_C_COMPILER} -shared -o ${LLVM_LINKED}.new ${names} -Wl,--version-script=${CMAKE_BINARY_DIR}/generated/llvm.map
      -Wl,--gc-sections -Wl,-Bsymbolic -Wl,-O1 -Wl,-s -Wl,-z,defs -Wl,-z,pack-relative-relocs
      -L${LLVM_LIBDIR} ${archives} -lz ${ZSTD_LIBRARY} -lstdc++ -lm -ldl -lpthread)
  if(failed)
    message(STATUS "LLVM is not linked from archives: ${LLVM_LIBRARY_FILE} will be loaded")
    file(REMOVE ${LLVM_LINKED}.new) # of a full disk, half of it
    set(LLVM_LINKED "")
  else()
    file(RENAME ${LLVM_LINKED}.new ${LLVM_LINKED})
  endif()
endif()
