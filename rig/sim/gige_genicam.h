#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

namespace rotunda::sim {

/// One feature that a client sees: a register with a name (GenICam standard feature naming).
struct Feature {
  enum class Kind { kInteger, kInteger64, kEnumeration, kBoolean, kCommand, kFloat, kText };
  enum class Access { kReadOnly, kReadWrite, kWriteOnly };
  Kind kind = Kind::kInteger;
  const char* category = "";
  const char* name = "";
  uint32_t address = 0;
  Access access = Access::kReadWrite;
  double min = 0;  // of numbers that can be written
  double max = 0;
  const char* unit = "";
  std::vector<std::pair<const char*, uint32_t>> entries = {};  // of an enumeration
  uint32_t command = 1;                                        // what a command writes
  uint32_t bytes = 4;                                          // of the register
  bool locked = false;  // not to be written while the camera takes pictures
};

/// All features of the simulated cameras; registers are checked by it too.
const std::vector<Feature>& Features();
/// The feature that can be written whose register begins at `address`; null when there is none.
const Feature* WritableAt(uint32_t address);

/// The GenICam description (GenApi schema 1.1) of the features, the same for every camera.
std::string GenicamXml();

}  // namespace rotunda::sim
