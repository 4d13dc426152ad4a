# SPDX-License-Identifier: Apache-2.0
# What every target needs: warnings, sanitizers, and a clear word when a package is missing.
include_guard(GLOBAL)

if(NOT CMAKE_BUILD_TYPE AND NOT CMAKE_CONFIGURATION_TYPES)
  set(CMAKE_BUILD_TYPE Release)
endif()

add_library(envbake_warnings INTERFACE)
add_library(envbake::warnings ALIAS envbake_warnings)
target_compile_options(envbake_warnings INTERFACE -Wall -Wextra -Wconversion -Wshadow)
# The ABI note concerns vector types passed between separately compiled files; ours stay inside one.
target_compile_options(envbake_warnings INTERFACE -Wno-psabi)
if(ENVBAKE_WERROR)
  target_compile_options(envbake_warnings INTERFACE -Werror)
endif()

if(ENVBAKE_SANITIZE)
  add_compile_options(-fsanitize=${ENVBAKE_SANITIZE} -fno-omit-frame-pointer -fno-sanitize-recover=all)
  add_link_options(-fsanitize=${ENVBAKE_SANITIZE})
endif()

# envbake_find_package(<CMake package> <Debian package> [find_package arguments])
macro(envbake_find_package name debian_name)
  find_package(${name} ${ARGN} QUIET)
  if(NOT ${name}_FOUND)
    message(FATAL_ERROR "${name} was not found. On Debian: apt-get install ${debian_name}")
  endif()
endmacro()

# envbake_find_pkgconfig(<target> <module> <Debian package>): imports PkgConfig::<target>
macro(envbake_find_pkgconfig target module debian_name)
  find_package(PkgConfig QUIET)
  if(NOT PkgConfig_FOUND)
    message(FATAL_ERROR "pkg-config was not found. On Debian: apt-get install pkg-config")
  endif()
  pkg_check_modules(${target} QUIET IMPORTED_TARGET GLOBAL ${module})
  if(NOT ${target}_FOUND)
    message(FATAL_ERROR "${module} was not found. On Debian: apt-get install ${debian_name}")
  endif()
endmacro()

# envbake_find_header(<INTERFACE target> <header> <Debian package>): header-only libraries
macro(envbake_find_header target header debian_name)
  find_path(${target}_INCLUDE_DIR ${header})
  if(NOT ${target}_INCLUDE_DIR)
    message(FATAL_ERROR "${header} was not found. On Debian: apt-get install ${debian_name}")
  endif()
  if(NOT TARGET ${target})
    add_library(${target} INTERFACE IMPORTED GLOBAL)
    target_include_directories(${target} SYSTEM INTERFACE ${${target}_INCLUDE_DIR})
  endif()
endmacro()
