#pragma once

#include <string_view>

namespace rotunda::sfm::report {

/// Style sheet and script of the report. Neither holds "<" or "&", so that the page is well-formed
/// XML as well as HTML.
std::string_view StyleSheet();
std::string_view Script();

}  // namespace rotunda::sfm::report
