# Highway: Debian 12 ships pkg-config files only.
find_path(HWY_INCLUDE_DIR hwy/highway.h)
find_library(HWY_LIBRARY hwy)
find_package(PkgConfig QUIET)
if(PKG_CONFIG_FOUND)
  pkg_check_modules(HWY_PC QUIET libhwy)
  set(HWY_VERSION ${HWY_PC_VERSION})
endif()
include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(HWY REQUIRED_VARS HWY_LIBRARY HWY_INCLUDE_DIR
                                  VERSION_VAR HWY_VERSION)
if(HWY_FOUND AND NOT TARGET HWY::hwy)
  add_library(HWY::hwy UNKNOWN IMPORTED)
  set_target_properties(HWY::hwy PROPERTIES IMPORTED_LOCATION ${HWY_LIBRARY}
                                            INTERFACE_INCLUDE_DIRECTORIES ${HWY_INCLUDE_DIR})
endif()
mark_as_advanced(HWY_INCLUDE_DIR HWY_LIBRARY)
