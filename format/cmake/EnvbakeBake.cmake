# SPDX-License-Identifier: Apache-2.0
# envbake_bake(TARGET <bundle> [SCENE <file>] [ENV <file>] [ARGS <option>...])
#
# Bakes <bundle>, relative to the current binary folder, whenever a file it is made of changes: the
# scene, every file that the scene names, the environment, or the tool. SCENE and ENV are relative to
# the current source folder. What is newer but the same bakes nothing. Names may hold spaces; where
# they hold "$" or "#", which CMake 3.25 loses when it rewrites depfiles for ninja, the tool is called
# by every build and finds that nothing has changed.
#
# Makes a target of the default build, bake_<bundle> with every character outside [A-Za-z0-9_] as
# "_"; targets that read the bundle add_dependencies() on it, from any folder. Bakes may run beside
# each other and beside anything else. The tool is ENVBAKE_EXECUTABLE where that is set (a cross
# build sets it), else the one of this package, else the one in PATH.
function(envbake_bake)
  cmake_parse_arguments(PARSE_ARGV 0 arg "" "TARGET;SCENE;ENV" "ARGS")
  if(NOT arg_TARGET OR NOT (arg_SCENE OR arg_ENV) OR arg_UNPARSED_ARGUMENTS)
    message(FATAL_ERROR "envbake_bake(TARGET <bundle> [SCENE <file>] [ENV <file>] [ARGS <option>...]): "
                        "needs TARGET, and SCENE or ENV; saw: ${ARGV}")
  endif()
  set(tool envbake::envbake)
  if(ENVBAKE_EXECUTABLE OR NOT TARGET envbake::envbake)
    find_program(ENVBAKE_EXECUTABLE envbake REQUIRED DOC "The envbake that envbake_bake() runs")
    set(tool ${ENVBAKE_EXECUTABLE})
  endif()

  cmake_path(ABSOLUTE_PATH arg_TARGET BASE_DIRECTORY ${CMAKE_CURRENT_BINARY_DIR} OUTPUT_VARIABLE bundle)
  cmake_path(GET bundle PARENT_PATH folder)
  file(MAKE_DIRECTORY ${folder})
  set(inputs)
  set(command ${tool} bake)
  if(arg_SCENE)
    cmake_path(ABSOLUTE_PATH arg_SCENE BASE_DIRECTORY ${CMAKE_CURRENT_SOURCE_DIR})
    list(APPEND inputs ${arg_SCENE})
    list(APPEND command ${arg_SCENE})
  endif()
  if(arg_ENV)
    cmake_path(ABSOLUTE_PATH arg_ENV BASE_DIRECTORY ${CMAKE_CURRENT_SOURCE_DIR})
    list(APPEND inputs ${arg_ENV})
    list(APPEND command --env ${arg_ENV})
  endif()
  add_custom_command(
    OUTPUT ${bundle}
    COMMAND ${command} -o ${bundle} --depfile ${bundle}.d --quiet ${arg_ARGS}
    DEPENDS ${inputs} ${tool}
    DEPFILE ${bundle}.d
    COMMENT "Baking ${arg_TARGET}"
    VERBATIM)
  string(MAKE_C_IDENTIFIER "bake_${arg_TARGET}" name)
  add_custom_target(${name} ALL DEPENDS ${bundle})
endfunction()
