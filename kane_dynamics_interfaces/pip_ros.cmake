# Lets CMake find a ROS that was installed with pip: `-DCMAKE_PROJECT_INCLUDE=.../pip_ros.cmake`.

# 1. Every folder on Python's path may be the prefix of ROS wheels, or lie in one.
find_package(Python3 REQUIRED COMPONENTS Interpreter)
execute_process(
  COMMAND "${Python3_EXECUTABLE}" -c "
import os, sys
found = {sys.prefix}
for path in sys.path:
    while path and path != os.path.dirname(path):
        found.add(path)
        path = os.path.dirname(path)
print(';'.join(sorted(p for p in found
                      if os.path.isdir(os.path.join(p, 'share', 'ament_cmake_core', 'cmake')))))"
  OUTPUT_VARIABLE ros_prefixes OUTPUT_STRIP_TRAILING_WHITESPACE COMMAND_ERROR_IS_FATAL ANY)
list(PREPEND CMAKE_PREFIX_PATH ${ros_prefixes})
string(REPLACE ";" ":" joined "${ros_prefixes}")
if(DEFINED ENV{AMENT_PREFIX_PATH} AND NOT "$ENV{AMENT_PREFIX_PATH}" STREQUAL "")
  set(ENV{AMENT_PREFIX_PATH} "${joined}:$ENV{AMENT_PREFIX_PATH}")
else()
  set(ENV{AMENT_PREFIX_PATH} "${joined}")
endif()

# 2. The wheels' targets carry include folders of the machine that built them: drop those.
function(_drop_missing_include_directories)
  get_property(targets DIRECTORY "${CMAKE_SOURCE_DIR}" PROPERTY IMPORTED_TARGETS)
  foreach(target IN LISTS targets)
    get_target_property(folders ${target} INTERFACE_INCLUDE_DIRECTORIES)
    if(folders)
      set(kept "")
      foreach(folder IN LISTS folders)
        if(NOT folder MATCHES "^/opt/python" OR EXISTS "${folder}")
          list(APPEND kept "${folder}")
        endif()
      endforeach()
      set_target_properties(${target} PROPERTIES INTERFACE_INCLUDE_DIRECTORIES "${kept}")
    endif()
  endforeach()
endfunction()
cmake_language(DEFER CALL _drop_missing_include_directories)

# 3. The generated files include the same large headers: those of a target are compiled together,
# which takes a fraction of the processor time; in two parts, since all else waits. Not those of
# rosidl_generator_c, which define the same names.
function(_compile_together)
  set(kinds fastrtps_c fastrtps_cpp introspection_c introspection_cpp c cpp)
  list(TRANSFORM kinds PREPEND rosidl_typesupport_)
  foreach(kind IN LISTS kinds ITEMS rosidl_generator_py)
    set(target ${PROJECT_NAME}__${kind})
    if(TARGET ${target})
      set_target_properties(${target} PROPERTIES UNITY_BUILD ON UNITY_BUILD_BATCH_SIZE 6)
    endif()
  endforeach()
endfunction()
cmake_language(DEFER CALL _compile_together)
