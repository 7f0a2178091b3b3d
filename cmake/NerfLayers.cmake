# A layer is an object library of src/<layer>/*.cc and of the FOLDERS below it that are named. The installed library is
# all layers together.
set(NERF_LAYERS "" CACHE INTERNAL "")
set(NERF_LINK "" CACHE INTERNAL "")
# What a program must be compiled with to agree with the library about its types (base/real.h).
set(NERF_DEFINITIONS "")
if(NERF_DOUBLE)
  set(NERF_DEFINITIONS NERF_DOUBLE)
endif()

add_library(nerf_flags INTERFACE)
target_compile_definitions(nerf_flags INTERFACE ${NERF_DEFINITIONS})
target_compile_features(nerf_flags INTERFACE cxx_std_20)
# No contraction and no fast-math: the same source gives the same bits at any optimisation level.
target_compile_options(nerf_flags INTERFACE -Wall -Wextra -Werror -fno-math-errno -ffp-contract=off)
target_include_directories(nerf_flags INTERFACE ${PROJECT_SOURCE_DIR}/include
                                                ${PROJECT_BINARY_DIR}/generated)

function(nerf_add_layer layer)
  cmake_parse_arguments(ARG "" "" "LINK;SOURCES;FOLDERS" ${ARGN})
  file(GLOB sources CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/src/${layer}/*.cc)
  foreach(folder ${ARG_FOLDERS})
    file(GLOB below CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/src/${layer}/${folder}/*.cc)
    list(APPEND sources ${below})
  endforeach()
  if(ARG_SOURCES)
    set(sources ${ARG_SOURCES})
  endif()
  set(NERF_LINK ${NERF_LINK} ${ARG_LINK} CACHE INTERNAL "")
  if(NOT sources)
    return()
  endif()
  add_library(nerf_layer_${layer} OBJECT ${sources})
  target_link_libraries(nerf_layer_${layer} PRIVATE nerf_flags ${ARG_LINK})
  target_include_directories(nerf_layer_${layer} PRIVATE ${PROJECT_SOURCE_DIR}/src)
  set(NERF_LAYERS ${NERF_LAYERS} ${layer} CACHE INTERNAL "")
endfunction()

# Kernel sources, and only they, are compiled for the processor family's wider instructions; Highway
# then adds the targets above that baseline and dispatches at run time. In double all of it falls back
# to scalar/, which stands on the templates of math/reference.
function(nerf_add_kernels_layer layer)
  set(folder ${PROJECT_SOURCE_DIR}/src/${layer})
  if(NERF_DOUBLE)
    file(GLOB scalar CONFIGURE_DEPENDS ${folder}/scalar/*.cc)
    nerf_add_layer(${layer} SOURCES ${scalar} ${folder}/adam.cc ${folder}/bf16.cc
                                    ${folder}/hash_grid.cc ${folder}/linear_bf16.cc
                                    ${folder}/roulette.cc)
    return()
  endif()
  nerf_add_layer(${layer} LINK HWY::hwy)
  set_target_properties(nerf_layer_${layer} PROPERTIES UNITY_BUILD OFF)
  if(TARGET nerf_layer_${layer} AND CMAKE_SYSTEM_PROCESSOR MATCHES "x86_64|AMD64")
    file(GLOB simd CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/src/${layer}/*_simd.cc)
    set_source_files_properties(${simd} PROPERTIES COMPILE_OPTIONS
                                "-march=x86-64-v3;-DHWY_DISABLE_PCLMUL_AES")
    # Highway 1.0.3 only emulates bf16 products, and truncates: intrinsics, chosen by cpuid.
    set(avx512 -march=x86-64-v4 -mavx512bf16)
    if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU")
      # g++ 12 warns of its own header: the intrinsics begin with an undefined register on purpose.
      list(APPEND avx512 -Wno-uninitialized -Wno-maybe-uninitialized)
    endif()
    set(amx ${avx512} -mamx-tile -mamx-bf16)
    set(vnni ${avx512} -mavx512vnni)
    set_source_files_properties(${PROJECT_SOURCE_DIR}/src/${layer}/bf16_avx512.cc
                                PROPERTIES COMPILE_OPTIONS "${avx512}")
    set_source_files_properties(${PROJECT_SOURCE_DIR}/src/${layer}/bf16_amx.cc
                                PROPERTIES COMPILE_OPTIONS "${amx}")
    set_source_files_properties(${PROJECT_SOURCE_DIR}/src/${layer}/descriptors_vnni.cc
                                PROPERTIES COMPILE_OPTIONS "${vnni}")
    set_source_files_properties(${PROJECT_SOURCE_DIR}/src/${layer}/descriptors_avx2.cc
                                PROPERTIES COMPILE_OPTIONS -march=x86-64-v3)
  endif()
endfunction()

function(nerf_add_library)
  add_library(nerf STATIC)
  add_library(nerf::nerf ALIAS nerf)
  foreach(layer ${NERF_LAYERS})
    target_sources(nerf PRIVATE $<TARGET_OBJECTS:nerf_layer_${layer}>)
  endforeach()
  list(REMOVE_DUPLICATES NERF_LINK)
  target_compile_features(nerf PUBLIC cxx_std_20)
  target_compile_definitions(nerf PUBLIC ${NERF_DEFINITIONS})
  target_include_directories(nerf PUBLIC $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}/include>
                                         $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}>)
  target_link_libraries(nerf PRIVATE ${NERF_LINK})
  set_target_properties(nerf PROPERTIES LINKER_LANGUAGE CXX)
endfunction()

# Tests of a layer: tests/<layer>/*_test.cc as one program that links this layer and those below it,
# so that a layer can be built and tested while one above it is in pieces. A folder that is named after
# no layer (tests/stress) links all of them.
function(nerf_add_layer_tests layer)
  file(GLOB sources CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/tests/${layer}/*_test.cc
                                      ${PROJECT_SOURCE_DIR}/tests/${layer}/*/*_test.cc)
  if(NOT sources)
    return()
  endif()
  add_executable(test_${layer} ${sources})
  target_link_libraries(test_${layer} PRIVATE nerf_flags GTest::gtest_main ${NERF_LINK})
  target_include_directories(test_${layer} PRIVATE ${PROJECT_SOURCE_DIR}/tests
                                                   ${PROJECT_SOURCE_DIR}/src)
  target_compile_definitions(test_${layer} PRIVATE NERF_SOURCE_DIR="${PROJECT_SOURCE_DIR}")
  # Tests of the stress layer compute much themselves; the others compile in two thirds of the time.
  # They stay apart from each other.
  if(layer STREQUAL stress)
    set_target_properties(test_${layer} PROPERTIES UNITY_BUILD OFF)
  else()
    target_compile_options(test_${layer} PRIVATE $<$<CONFIG:Release>:-O1>)
  endif()
  foreach(below ${NERF_LAYERS})
    target_link_libraries(test_${layer} PRIVATE nerf_layer_${below})
    if(below STREQUAL layer)
      break()
    endif()
  endforeach()
  nerf_discover_suites(test_${layer} PREFIX ${layer}. TIMEOUT 1800)
endfunction()
