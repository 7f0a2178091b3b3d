# ctest entries of a GoogleTest program: one a suite. A process for each test, as
# gtest_discover_tests() makes them, would spend a fifth of the time on loading shared libraries.

# Runs after each build of the program, and lists its suites for ctest.
#   nerf_discover_suites(TARGET PREFIX io. TIMEOUT 300 [FILTER "*Name*"] [ENVIRONMENT VAR=VALUE])
function(nerf_discover_suites target)
  cmake_parse_arguments(given "" "PREFIX;TIMEOUT;FILTER;ENVIRONMENT" "" ${ARGN})
  set(suites ${CMAKE_CURRENT_BINARY_DIR}/suites_${given_PREFIX}cmake)
  add_custom_command(
    TARGET ${target} POST_BUILD BYPRODUCTS ${suites} VERBATIM
    COMMAND ${CMAKE_COMMAND} -D PROGRAM=$<TARGET_FILE:${target}> -D PREFIX=${given_PREFIX}
            -D TIMEOUT=${given_TIMEOUT} -D FILTER=${given_FILTER} -D ENVIRONMENT=${given_ENVIRONMENT}
            -D OUT=${suites} -P ${PROJECT_SOURCE_DIR}/cmake/list_test_suites.cmake)
  # ctest fails on what was not built, rather than leave it out.
  set(included ${CMAKE_CURRENT_BINARY_DIR}/include_${given_PREFIX}cmake)
  file(WRITE ${included} "if(EXISTS \"${suites}\")\n  include(\"${suites}\")\nelse()\n"
                         "  add_test(${given_PREFIX}NOT_BUILT ${given_PREFIX}NOT_BUILT)\nendif()\n")
  set_property(DIRECTORY APPEND PROPERTY TEST_INCLUDE_FILES ${included})
endfunction()
