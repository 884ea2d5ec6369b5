# Run by `cmake --install` and cpack, which alone know the prefix: the unit names paths below it, and configuration goes to /etc
# when the prefix is /usr. `source_dir` and `binary_dir` are set by systemd/CMakeLists.txt.
set(prefix ${CMAKE_INSTALL_PREFIX})
if(prefix STREQUAL "/usr")
  set(config_dir /etc/rotunda)
else()
  set(config_dir ${prefix}/etc/rotunda)
endif()
configure_file(${source_dir}/systemd/rotunda.service.in ${binary_dir}/rotunda.service @ONLY)
file(INSTALL ${binary_dir}/rotunda.service DESTINATION ${prefix}/lib/systemd/system)
foreach(name rotundad.toml capture.toml cuboid.toml)
  # What an operator has entered stays.
  if(NOT EXISTS $ENV{DESTDIR}${config_dir}/${name})
    file(INSTALL ${source_dir}/config/${name} DESTINATION ${config_dir})
  endif()
endforeach()
