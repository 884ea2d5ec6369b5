#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "sfm/core/result.h"
#include "sfm/reconstruction.h"

namespace rotunda::sfm {

// Models for other programs. `image_names` are the pictures' files by ImageId; unregistered images
// are left out; `folder` exists. Positions stay in the model's frame and unit (the rig's, metres,
// when it was aligned to a calibration). kInvalidArgument names the camera whose lens no format
// here can hold, FULL_OPENCV with a denominator (k4, k5 or k6 other than 0), and the lens models
// that can be held. The formats' lens is
//   d = 1 + k1 r^2 + k2 r^4 + k3 r^6,  r^2 = x^2 + y^2,  x = X/Z, y = Y/Z (x right, y down)
//   x' = x d + 2 p1 x y + p2 (r^2 + 2 x^2),  y' = y d + 2 p2 x y + p1 (r^2 + 2 y^2)
// with p1 and p2 as in COLMAP and OpenCV.

/// transforms.json and sparse_pc.ply of nerfstudio, camera model OPENCV with an intrinsics block a
/// frame (its documentation, "Data conventions", and its reader, nerfstudio_dataparser.py).
/// transform_matrix is world_from_camera, 4x4, the camera's axes as OpenGL has them (x right, y up,
/// z back); the world is the model, z up in the rig's frame, so that applied_transform is the
/// identity. cx, cy: (0, 0) is the corner of the top-left pixel, as here. Pictures are looked for
/// as images/<name> beside transforms.json.
Status WriteNerfstudioModel(const Reconstruction& reconstruction,
                            const std::vector<std::string>& image_names,
                            const std::filesystem::path& folder);

/// cameras.xml as Metashape exports and imports cameras ("Agisoft XML", document 2.0.0), a sensor a
/// lens. A camera's transform is chunk_from_camera, 4x4 by rows, axes x right, y down, z forward;
/// the transform of the component, from the chunk to the world, is the identity. Its label, by
/// which Metashape finds the picture, is the file's name without ending. Metashape's manual,
/// appendix "Camera models", frame cameras, has p1 and p2 the other way round, the principal point
/// from the picture's centre and one focal length:
///   u = w/2 + cx + f x' + b1 x' + b2 y',  v = h/2 + cy + f y',  so f = fy, b1 = fx - fy, b2 = 0.
/// kInvalidArgument also when two labels are the same.
Status WriteMetashapeModel(const Reconstruction& reconstruction,
                           const std::vector<std::string>& image_names,
                           const std::filesystem::path& folder);

/// One XMP file a picture, <name without ending>.xmp, to lie beside it when RealityCapture (now
/// RealityScan) imports it; poses locked, calibration exact. As in Capturing Reality's article
/// "RealityCapture XMP camera math":
///   x = Rotation (X - Position), Rotation by rows, camera axes x right, y down, z forward;
///   the lens is applied before focal length and principal point, which are in units of the longer
///   side s of the picture: u = w/2 + s (f x' + PrincipalPointU), v = h/2 + s (f a y' +
///   PrincipalPointV), f = FocalLength35mm / 36, a = AspectRatio (1 unless fx and fy differ).
/// DistortionCoeficients (their spelling) are k1 k2 k3 k4 t1 t2 with t1 = p2, t2 = p1: the
/// program's own export "OpenCV-compliant" writes k1,k2,t2,t1; the converters EasyVolcap
/// (rc_utils.py) and camorph do the same. What the article leaves open: the tangential order, the
/// longer side for V, and the aspect ratio as fy/fx are as those have them. The 3-D points cannot
/// be given to RealityCapture. Its own default lens (Alignment settings, Advanced, Distortion
/// model) is Brown3, which has no tangential part: Brown3 with tangential2 is to be chosen there.
/// kInvalidArgument also when two pictures would have one XMP file.
Status WriteRealityCaptureModel(const Reconstruction& reconstruction,
                                const std::vector<std::string>& image_names,
                                const std::filesystem::path& folder);

}  // namespace rotunda::sfm
