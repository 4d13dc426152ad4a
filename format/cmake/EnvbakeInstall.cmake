# SPDX-License-Identifier: Apache-2.0
# What `cmake --install` and `cpack` hand out: the libraries with their headers, a CMake package, a
# pkg-config file, and, where the baker is built, the tool with its man pages and completions.
# Paths in the installed files are relative to them: the tree may be moved.
include(GNUInstallDirs)
include(CMakePackageConfigHelpers)

set(config_folder ${CMAKE_INSTALL_LIBDIR}/cmake/envbake)
set_target_properties(envbake_format PROPERTIES EXPORT_NAME format)
set_target_properties(envbake_runtime_min PROPERTIES EXPORT_NAME runtime_min)
install(TARGETS envbake_format envbake_runtime_min EXPORT envbakeTargets)
install(DIRECTORY ${PROJECT_SOURCE_DIR}/format/include/ ${PROJECT_SOURCE_DIR}/runtime_min/include/
  DESTINATION ${CMAKE_INSTALL_INCLUDEDIR})
if(ENVBAKE_BUILD_BAKER)
  install(TARGETS envbake EXPORT envbakeTargets)
  set(manual ${PROJECT_BINARY_DIR}/manual)
  install(DIRECTORY ${manual}/man1 DESTINATION ${CMAKE_INSTALL_MANDIR})
  install(DIRECTORY ${manual}/bash/ DESTINATION ${CMAKE_INSTALL_DATADIR}/bash-completion/completions)
  install(DIRECTORY ${manual}/zsh/ DESTINATION ${CMAKE_INSTALL_DATADIR}/zsh/site-functions)
endif()
install(EXPORT envbakeTargets NAMESPACE envbake:: DESTINATION ${config_folder})

set(pkgconfig_modules)
if(ENVBAKE_WITH_ZSTD)
  list(APPEND pkgconfig_modules libzstd)
endif()
if(ENVBAKE_WITH_XXHASH)
  list(APPEND pkgconfig_modules libxxhash)
endif()
list(JOIN pkgconfig_modules ", " pkgconfig_requires)

set(module_folder ${PROJECT_SOURCE_DIR}/format/cmake)
configure_package_config_file(${module_folder}/envbakeConfig.cmake.in envbakeConfig.cmake
  INSTALL_DESTINATION ${config_folder})
write_basic_package_version_file(envbakeConfigVersion.cmake COMPATIBILITY SameMajorVersion)
install(FILES
  ${CMAKE_CURRENT_BINARY_DIR}/envbakeConfig.cmake
  ${CMAKE_CURRENT_BINARY_DIR}/envbakeConfigVersion.cmake
  ${module_folder}/EnvbakeBake.cmake
  DESTINATION ${config_folder})

set(pkgconfig_folder ${CMAKE_INSTALL_LIBDIR}/pkgconfig)
file(RELATIVE_PATH prefix_from_pkgconfig /${pkgconfig_folder} /)
configure_file(${module_folder}/envbake.pc.in envbake.pc @ONLY)
install(FILES ${CMAKE_CURRENT_BINARY_DIR}/envbake.pc DESTINATION ${pkgconfig_folder})

set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_CONTACT "the envbake developers")
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
# Linking the runtime needs these, baking does not.
set(CPACK_DEBIAN_PACKAGE_RECOMMENDS "libzstd-dev, libxxhash-dev, pkg-config")
include(CPack)
