#include "rig/sim/gige_registers.h"

#include <algorithm>
#include <bit>

namespace rotunda::sim {

RegisterMap::RegisterMap(std::string_view xml) : memory_(reg::kEnd), xml_(xml) {}

bool RegisterMap::Contains(uint32_t address, size_t size) const {
  const uint64_t end = uint64_t{address} + size;
  // The last block a client reads of the description may reach beyond its end.
  const uint64_t xml_end = uint64_t{reg::kXml} + xml_.size() + kGvcpMaxData;
  return end <= memory_.size() || (address >= reg::kXml && end <= xml_end);
}

Bytes RegisterMap::Read(uint32_t address, size_t size) const {
  Bytes bytes(size);
  const auto copy = [&](const auto& from, size_t at) {
    if (at >= from.size()) return;
    const size_t count = std::min(size, from.size() - at);
    std::copy_n(from.begin() + at, count, bytes.begin());
  };
  if (address >= reg::kXml) {
    copy(xml_, address - reg::kXml);
  } else {
    copy(memory_, address);
  }
  return bytes;
}

uint32_t RegisterMap::Get(uint32_t address) const { return ReadBig32(memory_, address); }

uint64_t RegisterMap::Get64(uint32_t address) const {
  return uint64_t{Get(address)} << 32 | Get(address + 4);
}

double RegisterMap::GetFloat(uint32_t address) const {
  return std::bit_cast<double>(Get64(address));
}

void RegisterMap::Set(uint32_t address, uint32_t value) { WriteBig32(memory_, address, value); }

void RegisterMap::Set64(uint32_t address, uint64_t value) {
  Set(address, static_cast<uint32_t>(value >> 32));
  Set(address + 4, static_cast<uint32_t>(value));
}

void RegisterMap::SetFloat(uint32_t address, double value) {
  Set64(address, std::bit_cast<uint64_t>(value));
}

void RegisterMap::SetText(uint32_t address, std::string_view text, size_t size) {
  Bytes bytes(size);
  std::copy_n(text.begin(), std::min(text.size(), size - 1), bytes.begin());
  SetBytes(address, bytes);
}

void RegisterMap::SetBytes(uint32_t address, std::span<const uint8_t> bytes) {
  std::copy(bytes.begin(), bytes.end(), memory_.begin() + address);
}

}  // namespace rotunda::sim
