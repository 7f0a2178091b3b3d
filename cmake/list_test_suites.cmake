# Writes an add_test() for each suite of a GoogleTest program; see TestSuites.cmake.
#   cmake -D PROGRAM=... -D PREFIX=... -D TIMEOUT=seconds [-D FILTER=...] [-D ENVIRONMENT=VAR=VALUE]
#         -D OUT=file -P list_test_suites.cmake
set(arguments --gtest_list_tests)
if(FILTER)
  list(APPEND arguments --gtest_filter=${FILTER})
endif()
execute_process(COMMAND ${PROGRAM} ${arguments} OUTPUT_VARIABLE listing RESULT_VARIABLE code)
if(NOT code EQUAL 0)
  message(FATAL_ERROR "${PROGRAM} does not list its tests (${code})")
endif()
# A suite is a line that ends in a dot; its tests, indented, follow.
string(REGEX REPLACE "[[;]|]" "" listing "${listing}")
string(REPLACE "\n" ";" lines "${listing}")
set(text "")
set(suite "")
macro(finish_suite)
  if(suite)
    # ctest begins with what costs most: suites of many tests.
    string(APPEND text "add_test([=[${PREFIX}${suite}]=] [=[${PROGRAM}]=] "
                       "[=[--gtest_filter=${suite}.*]=])\n"
                       "set_tests_properties([=[${PREFIX}${suite}]=] PROPERTIES "
                       "TIMEOUT ${TIMEOUT} COST ${tests}")
    if(ENVIRONMENT)
      string(APPEND text " ENVIRONMENT [=[${ENVIRONMENT}]=]")
    endif()
    string(APPEND text ")\n")
  endif()
endmacro()
foreach(line IN LISTS lines)
  if(line MATCHES "^([A-Za-z0-9_/]+)[.]( +#.*)?$")
    finish_suite()
    set(suite ${CMAKE_MATCH_1})
    set(tests 0)
  elseif(line MATCHES "^  ")
    math(EXPR tests "${tests} + 1")
  endif()
endforeach()
finish_suite()
if(NOT text)
  message(FATAL_ERROR "${PROGRAM} has no tests like '${FILTER}'")
endif()
file(WRITE ${OUT} "${text}")
