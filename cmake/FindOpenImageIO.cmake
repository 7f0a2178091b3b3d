# OpenImageIO: Debian's config package asks for Imath's Python binding, which nothing here uses.
find_path(OPENIMAGEIO_INCLUDE_DIR OpenImageIO/imageio.h)
find_library(OPENIMAGEIO_LIBRARY OpenImageIO)
find_library(OPENIMAGEIO_UTIL_LIBRARY OpenImageIO_Util)
if(OPENIMAGEIO_INCLUDE_DIR)
  file(STRINGS ${OPENIMAGEIO_INCLUDE_DIR}/OpenImageIO/oiioversion.h lines
       REGEX "#define OIIO_VERSION_(MAJOR|MINOR|PATCH)")
  string(REGEX REPLACE ".*MAJOR +([0-9]+).*MINOR +([0-9]+).*PATCH +([0-9]+).*" "\\1.\\2.\\3"
                       OPENIMAGEIO_VERSION "${lines}")
endif()
include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(OpenImageIO
  REQUIRED_VARS OPENIMAGEIO_LIBRARY OPENIMAGEIO_UTIL_LIBRARY OPENIMAGEIO_INCLUDE_DIR
  VERSION_VAR OPENIMAGEIO_VERSION)
if(OpenImageIO_FOUND AND NOT TARGET OpenImageIO::OpenImageIO)
  add_library(OpenImageIO::OpenImageIO UNKNOWN IMPORTED)
  set_target_properties(OpenImageIO::OpenImageIO PROPERTIES
    IMPORTED_LOCATION ${OPENIMAGEIO_LIBRARY}
    INTERFACE_INCLUDE_DIRECTORIES ${OPENIMAGEIO_INCLUDE_DIR}
    INTERFACE_LINK_LIBRARIES ${OPENIMAGEIO_UTIL_LIBRARY})
endif()
mark_as_advanced(OPENIMAGEIO_INCLUDE_DIR OPENIMAGEIO_LIBRARY OPENIMAGEIO_UTIL_LIBRARY)
