#pragma once

#include "tests/bench/disambiguation_captures.h"

namespace rotunda::bench {

/// Makes a capture's frame set and stages from those of the capture it is made from, whose stages
/// stand up to the two-view geometries. Pictures are shared, what the change leaves as it is is not
/// computed again. `to.expected` lists the cameras that a reconstruction should name: {"moved":
/// [...], "swapped": [...]}. Does nothing when the capture is there.
void MakeChanged(const Capture& capture, const CaptureFiles& from, const CaptureFiles& to);

}  // namespace rotunda::bench
