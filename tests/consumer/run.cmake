# Installs a build tree into a prefix of its own, moves the prefix (a package must not remember where
# it was made), builds the consumer against it with default flags and with -march=native, runs both.
#
#   cmake -D BUILD=... -D SOURCE=... -D WORK=... -D CAPTURE=... -D COMPILER=... -D FLAGS=... -P run.cmake
foreach(name BUILD SOURCE WORK CAPTURE COMPILER)
  if(NOT ${name})
    message(FATAL_ERROR "run.cmake needs -D ${name}=...")
  endif()
endforeach()

function(run)
  execute_process(COMMAND ${ARGN} RESULT_VARIABLE code OUTPUT_VARIABLE text ERROR_VARIABLE text)
  if(NOT code EQUAL 0)
    string(REPLACE ";" " " line "${ARGN}")
    message(FATAL_ERROR "failed (${code}): ${line}\n${text}")
  endif()
  set(output "${text}" PARENT_SCOPE)
endfunction()

file(REMOVE_RECURSE ${WORK})
run(${CMAKE_COMMAND} --install ${BUILD} --prefix ${WORK}/first)
file(RENAME ${WORK}/first ${WORK}/prefix)

# No path of the build machine in what was installed for CMake.
cmake_path(GET SOURCE PARENT_PATH tests)
cmake_path(GET tests PARENT_PATH project)
file(GLOB_RECURSE package_files ${WORK}/prefix/*.cmake)
if(NOT package_files)
  message(FATAL_ERROR "no package file was installed")
endif()
foreach(file ${package_files})
  file(READ ${file} text)
  foreach(path ${project} ${BUILD} ${WORK}/first)
    string(FIND "${text}" "${path}/" position)
    if(NOT position EQUAL -1)
      message(FATAL_ERROR "${file} mentions ${path}")
    endif()
  endforeach()
endforeach()

foreach(variant default native)
  set(flags "${FLAGS}")
  set(headers ON)
  if(variant STREQUAL native)
    string(APPEND flags " -march=native")
    set(headers OFF)
  endif()
  set(build ${WORK}/${variant})
  run(${CMAKE_COMMAND} -S ${SOURCE} -B ${build} -G Ninja -D CMAKE_BUILD_TYPE=Release
      -D CMAKE_PREFIX_PATH=${WORK}/prefix -D CMAKE_CXX_COMPILER=${COMPILER}
      -D CMAKE_CXX_FLAGS=${flags} -D NERF_CONSUMER_HEADERS=${headers})
  run(${CMAKE_COMMAND} --build ${build})
  run(${CMAKE_COMMAND} -E chdir ${build} ./consumer ${CAPTURE})
  message(STATUS "${variant}: ${output}")
endforeach()
file(REMOVE_RECURSE ${WORK})
