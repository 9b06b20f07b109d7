# Read by every project() of the build (CMAKE_PROJECT_INCLUDE) when ROS comes as wheels.
#
# The exported targets *__rosidl_generator_py of the wheels name the Python and numpy include
# directories of the machine that built them.  Once the project is read, those are replaced by
# the ones of the Python that builds here.  No file of a wheel is changed.
function(use_own_python_headers)
  find_package(Python3 REQUIRED COMPONENTS Interpreter Development NumPy)
  get_property(targets DIRECTORY PROPERTY IMPORTED_TARGETS)
  foreach(target IN LISTS targets)
    if(target MATCHES "__rosidl_generator_py$")
      set_target_properties(${target} PROPERTIES INTERFACE_INCLUDE_DIRECTORIES
        "${Python3_INCLUDE_DIRS};${Python3_NumPy_INCLUDE_DIRS}")
    endif()
  endforeach()
endfunction()
cmake_language(DEFER CALL use_own_python_headers)
