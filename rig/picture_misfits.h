#pragma once

#include <vector>

#include "rig/rig_calibration.h"

namespace rotunda::rig {

/// A threshold that `lost` of `count` normal deviates in the plane exceed: exp(-t^2 / 2) = share.
double ThresholdSigmas(size_t count, double lost);

bool IsLeftOut(const std::vector<DroppedPicture>& dropped, const FaceView& view);
std::vector<FaceView> Without(const std::vector<FaceView>& views,
                              const std::vector<DroppedPicture>& dropped);

/// Pictures and shots most of whose corners do not fit.
std::vector<DroppedPicture> FindMisfits(const BoardSightings& sightings,
                                        const std::vector<FaceView>& views, const BoardShape& shape,
                                        const RigCalibration& result,
                                        const RigCalibrationOptions& options);

/// A picture's noise never comes twice. Shots most of whose cameras have a face in common to the
/// last bit are one shot: an error. A single camera that does has sent an earlier frame again: that
/// picture is to be left out.
Result<std::vector<DroppedPicture>> FindRepeats(const BoardSightings& sightings,
                                                const std::vector<FaceView>& views);

}  // namespace rotunda::rig
