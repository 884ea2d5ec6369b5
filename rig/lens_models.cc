#include "rig/lens_models.h"

namespace rotunda::rig {

const std::map<std::string, LensModel>& LensModelsByName() {
  static const std::map<std::string, LensModel> models = {{"opencv", LensModel::kOpencv},
                                                          {"opencv5", LensModel::kOpencv5},
                                                          {"full-opencv", LensModel::kFullOpencv}};
  return models;
}

}  // namespace rotunda::rig
