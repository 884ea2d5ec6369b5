#include "config/sim_config.h"

#include "config/toml_reader.h"
#include "sfm/core/file_io.h"

namespace rotunda::config {

Result<sim::RigOptions> ParseRigOptions(const std::string& text, const std::string& source) {
  ROTUNDA_ASSIGN_OR_RETURN(const TomlFile file, TomlFile::Parse(text, source));
  sim::RigOptions options;
  sim::RigGeometry& rig = options.geometry;
  sim::RigCamera& camera = options.camera;
  sim::RigJitter& jitter = options.jitter;
  sim::RigSensor& sensor = options.sensor;
  ROTUNDA_RETURN_IF_ERROR(file.Read({
      {"rig",
       {{"columns", &rig.columns},
        {"rows", &rig.rows},
        {"radius_mm", &rig.radius_mm},
        {"lowest_mm", &rig.lowest_mm},
        {"highest_mm", &rig.highest_mm},
        {"aim_lowest_mm", &rig.aim_lowest_mm},
        {"aim_highest_mm", &rig.aim_highest_mm}}},
      {"camera",
       {{"width_px", &camera.width_px},
        {"height_px", &camera.height_px},
        {"focal_px", &camera.focal_px},
        {"k1", &camera.k1},
        {"k2", &camera.k2},
        {"p1", &camera.p1},
        {"p2", &camera.p2}}},
      {"jitter",
       {{"position_mm", &jitter.position_mm},
        {"aim_deg", &jitter.aim_deg},
        {"roll_deg", &jitter.roll_deg},
        {"focal_percent", &jitter.focal_percent},
        {"principal_point_px", &jitter.principal_point_px},
        {"radial_percent", &jitter.radial_percent},
        {"tangential", &jitter.tangential}}},
      {"sensor",
       {{"vignetting", &sensor.vignetting},
        {"gain_spread_percent", &sensor.gain_spread_percent},
        {"colour_spread_percent", &sensor.colour_spread_percent},
        {"full_well_e", &sensor.full_well_e},
        {"read_noise_e", &sensor.read_noise_e},
        {"blur_px", &sensor.blur_px},
        {"exposure_us", &sensor.exposure_us}}},
  }));
  if (Status status = options.Validate(); !status) return file.Located(status.error());
  return options;
}

Result<sim::RigOptions> ReadRigOptions(const std::filesystem::path& file) {
  ROTUNDA_ASSIGN_OR_RETURN(const std::string text, ReadFile(file));
  return ParseRigOptions(text, file.string());
}

}  // namespace rotunda::config
