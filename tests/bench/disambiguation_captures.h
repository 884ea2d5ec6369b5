#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace rotunda::bench {

/// How a capture differs from the one it is made from.
enum class Change {
  kNone,
  kThinnedToHalf,     // a random half of the keypoints of every picture
  kThinnedToQuarter,  // likewise
  kMissing,           // 5 % of the cameras took no picture
  kMoved,             // one camera stands 20 mm beside its place in the calibration
  kSwapped,           // two cameras have each other's place in the calibration
};

/// A part of a picture, pixels.
struct PictureBox {
  std::string picture;  // file without its ending
  double left = 0, top = 0, right = 0, bottom = 0;
};

/// Two copies of one object that stand in different places.
struct Scene {
  std::string truth;  // how that is known
  /// By copy: a box that nothing but the copy is in.
  std::vector<PictureBox> copies;
  /// By copy: pictures that show it and not the other one, to be drawn.
  std::vector<std::vector<std::string>> pictures;
};

struct Capture {
  std::string name;
  std::vector<std::string> simulate;  // options of `rotunda simulate`; empty: not simulated
  std::string garment;    // "unique", "twin", "twin-symmetric", "plaid"; empty: not simulated
  double scale = 1;       // of the pictures; 1 is 1200x1600
  std::string made_from;  // name of the capture that `change` is applied to, if any
  Change change = Change::kNone;
  std::filesystem::path photographs;  // folder of pictures, if not simulated
  Scene scene;                        // what they show
  bool with_colmap = false;           // colmap's mapper is run on it, too
  std::string unavailable;            // why it cannot be had; empty: it can
};

/// Size of the simulated captures.
struct CaptureSize {
  int cameras = 90;
  double scale = 0.5;  // of 1200x1600 pixels
};

/// Bodies x garments x seeds; garments whose front and back look alike are most of it.
std::vector<Capture> MeanCaptures(const CaptureSize& size);
/// Four of them with pictures of the rig's full size.
std::vector<Capture> FullSizeCaptures(const CaptureSize& size);
/// A body and seeds that were never looked at while the method was made.
std::vector<Capture> HeldOutCaptures(const CaptureSize& size);
/// Captures of the mean set with something wrong, or with less to tell front from back by.
std::vector<Capture> StressCaptures(const CaptureSize& size);
/// The captures of the mean set on which every part of the method is tried alone.
std::vector<Capture> AblationCaptures(const CaptureSize& size);
/// Real photographs of things that look alike.
std::vector<Capture> PhotographCaptures();

/// Where what belongs to a capture stands in the work folder.
struct CaptureFiles {
  std::filesystem::path frameset;
  std::filesystem::path stages;
  std::filesystem::path truth;     // there only for simulated captures
  std::filesystem::path expected;  // what a changed capture's result should name
};
CaptureFiles FilesOf(const Capture& capture, const std::filesystem::path& work);

/// Makes what is missing of a capture and of what it is made from. The error of a program that
/// failed ends this one.
void PrepareCapture(const Capture& capture, const std::filesystem::path& work);

/// The call of `rotunda reconstruct` that takes from the capture's stages what stands there already
/// and writes the rest.
std::vector<std::string> ReconstructCommand(const CaptureFiles& files,
                                            const std::vector<std::string>& options,
                                            const std::filesystem::path& out);

/// Makes those of features, matches and two-view geometries that are not there yet; with options of
/// `rotunda reconstruct` for them, all or none. The frame set must be there.
void PrepareStages(const CaptureFiles& files, const std::vector<std::string>& options);

}  // namespace rotunda::bench
