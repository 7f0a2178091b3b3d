# Installs the static library, its public headers and a package that find_package(nerf) finds, which
# gives the target nerf::nerf. Header-only libraries that only our sources use stay out of the
# package: a consumer needs no Eigen and no nlohmann-json.
include(CMakePackageConfigHelpers)

set(NERF_CMAKE_DIR ${CMAKE_INSTALL_LIBDIR}/cmake/nerf)

get_target_property(nerf_links nerf INTERFACE_LINK_LIBRARIES)
if(nerf_links)
  list(REMOVE_ITEM nerf_links $<LINK_ONLY:Eigen3::Eigen> $<LINK_ONLY:nlohmann_json::nlohmann_json>)
  set_target_properties(nerf PROPERTIES INTERFACE_LINK_LIBRARIES "${nerf_links}")
endif()

install(TARGETS nerf EXPORT nerfTargets ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR})
install(DIRECTORY ${PROJECT_SOURCE_DIR}/include/nerf DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}
        FILES_MATCHING PATTERN "*.h")
install(EXPORT nerfTargets NAMESPACE nerf:: DESTINATION ${NERF_CMAKE_DIR})

configure_package_config_file(${CMAKE_CURRENT_LIST_DIR}/nerfConfig.cmake.in
                              ${PROJECT_BINARY_DIR}/nerfConfig.cmake
                              INSTALL_DESTINATION ${NERF_CMAKE_DIR})
# Before 1.0 a minor version may change the interface.
write_basic_package_version_file(${PROJECT_BINARY_DIR}/nerfConfigVersion.cmake
                                 COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/nerfConfig.cmake ${PROJECT_BINARY_DIR}/nerfConfigVersion.cmake
              ${CMAKE_CURRENT_LIST_DIR}/FindHWY.cmake
              ${CMAKE_CURRENT_LIST_DIR}/FindOpenImageIO.cmake
              ${CMAKE_CURRENT_LIST_DIR}/FindOpenEXR.cmake
        DESTINATION ${NERF_CMAKE_DIR})
install(FILES ${PROJECT_SOURCE_DIR}/LICENSE DESTINATION ${CMAKE_INSTALL_DOCDIR})
