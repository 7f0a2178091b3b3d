# OpenEXR and the library of its vectors: Debian's config package of Imath asks for its Python binding, which nothing
# here uses.
find_path(OPENEXR_INCLUDE_DIR OpenEXR/ImfOutputFile.h)
find_path(IMATH_INCLUDE_DIR Imath/ImathVec.h)
find_library(OPENEXR_LIBRARY NAMES OpenEXR OpenEXR-3_1)
find_library(IEX_LIBRARY NAMES Iex Iex-3_1)
find_library(IMATH_LIBRARY NAMES Imath Imath-3_1)
if(OPENEXR_INCLUDE_DIR)
  file(STRINGS ${OPENEXR_INCLUDE_DIR}/OpenEXR/OpenEXRConfig.h line REGEX "#define OPENEXR_VERSION_STRING ")
  string(REGEX REPLACE ".*\"([0-9.]+)\".*" "\\1" OPENEXR_VERSION "${line}")
endif()
include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(OpenEXR
  REQUIRED_VARS OPENEXR_LIBRARY IEX_LIBRARY IMATH_LIBRARY OPENEXR_INCLUDE_DIR IMATH_INCLUDE_DIR
  VERSION_VAR OPENEXR_VERSION)
if(OpenEXR_FOUND AND NOT TARGET OpenEXR::OpenEXR)
  add_library(OpenEXR::OpenEXR UNKNOWN IMPORTED)
  # Their headers include each other without a folder.
  set_target_properties(OpenEXR::OpenEXR PROPERTIES
    IMPORTED_LOCATION ${OPENEXR_LIBRARY}
    INTERFACE_INCLUDE_DIRECTORIES
      "${OPENEXR_INCLUDE_DIR};${OPENEXR_INCLUDE_DIR}/OpenEXR;${IMATH_INCLUDE_DIR};${IMATH_INCLUDE_DIR}/Imath"
    INTERFACE_LINK_LIBRARIES "${IEX_LIBRARY};${IMATH_LIBRARY}")
endif()
mark_as_advanced(OPENEXR_INCLUDE_DIR IMATH_INCLUDE_DIR OPENEXR_LIBRARY IEX_LIBRARY IMATH_LIBRARY)
