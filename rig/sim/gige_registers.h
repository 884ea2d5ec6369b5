#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "rig/sim/gige_packets.h"

namespace rotunda::sim {

/// Addresses of the bootstrap registers (GigE Vision 1.2, 27) and of our features.
namespace reg {
inline constexpr uint32_t kVersion = 0x0000;
inline constexpr uint32_t kDeviceMode = 0x0004;
inline constexpr uint32_t kMacHigh = 0x0008;
inline constexpr uint32_t kMacLow = 0x000C;
inline constexpr uint32_t kIpConfigSupported = 0x0010;
inline constexpr uint32_t kIpConfigCurrent = 0x0014;
inline constexpr uint32_t kCurrentIp = 0x0024;
inline constexpr uint32_t kSubnetMask = 0x0034;
inline constexpr uint32_t kVendorName = 0x0048;
inline constexpr uint32_t kModelName = 0x0068;
inline constexpr uint32_t kDeviceVersion = 0x0088;
inline constexpr uint32_t kManufacturerInfo = 0x00A8;
inline constexpr uint32_t kSerialNumber = 0x00D8;
inline constexpr uint32_t kUserName = 0x00E8;
inline constexpr uint32_t kDiscoveryEnd = 0x00F8;  // what a discovery answer contains ends here
inline constexpr uint32_t kXmlUrl = 0x0200;
inline constexpr uint32_t kInterfaces = 0x0600;
inline constexpr uint32_t kStreamChannels = 0x0904;
inline constexpr uint32_t kCapability = 0x0934;
inline constexpr uint32_t kHeartbeatTimeout = 0x0938;  // ms
inline constexpr uint32_t kTickFrequency = 0x093C;     // 64 bit
inline constexpr uint32_t kTimestampControl = 0x0944;
inline constexpr uint32_t kTimestampLatched = 0x0948;  // 64 bit
inline constexpr uint32_t kControlPrivilege = 0x0A00;
inline constexpr uint32_t kStreamPort = 0x0D00;
inline constexpr uint32_t kStreamPacketSize = 0x0D04;
inline constexpr uint32_t kStreamPacketDelay = 0x0D08;  // ticks
inline constexpr uint32_t kStreamAddress = 0x0D18;

inline constexpr uint32_t kFeatures = 0x10000;
inline constexpr uint32_t kSensorWidth = kFeatures + 0x00;
inline constexpr uint32_t kSensorHeight = kFeatures + 0x04;
inline constexpr uint32_t kWidth = kFeatures + 0x08;
inline constexpr uint32_t kHeight = kFeatures + 0x0C;
inline constexpr uint32_t kOffsetX = kFeatures + 0x10;
inline constexpr uint32_t kOffsetY = kFeatures + 0x14;
inline constexpr uint32_t kPixelFormat = kFeatures + 0x18;
inline constexpr uint32_t kAcquisitionMode = kFeatures + 0x20;
inline constexpr uint32_t kAcquisition = kFeatures + 0x24;  // 1: start, 0: stop
inline constexpr uint32_t kFrameRate = kFeatures + 0x28;    // float, Hz
inline constexpr uint32_t kTriggerSelector = kFeatures + 0x30;
inline constexpr uint32_t kTriggerMode = kFeatures + 0x34;
inline constexpr uint32_t kTriggerSource = kFeatures + 0x38;
inline constexpr uint32_t kTriggerActivation = kFeatures + 0x3C;
inline constexpr uint32_t kTriggerSoftware = kFeatures + 0x40;
inline constexpr uint32_t kTriggerArmed = kFeatures + 0x44;
inline constexpr uint32_t kTriggerDelay = kFeatures + 0x48;  // float, us
inline constexpr uint32_t kExposureMode = kFeatures + 0x50;
inline constexpr uint32_t kExposureAuto = kFeatures + 0x54;
inline constexpr uint32_t kExposureTime = kFeatures + 0x58;  // float, us
inline constexpr uint32_t kGain = kFeatures + 0x60;          // float, dB
inline constexpr uint32_t kGainAuto = kFeatures + 0x68;
inline constexpr uint32_t kTemperature = kFeatures + 0x70;  // float, degrees Celsius
inline constexpr uint32_t kDeviceReset = kFeatures + 0x78;
inline constexpr uint32_t kChunkMode = kFeatures + 0x7C;
inline constexpr uint32_t kPtpEnable = kFeatures + 0x80;
inline constexpr uint32_t kPtpStatus = kFeatures + 0x84;
inline constexpr uint32_t kPtpOffset = kFeatures + 0x88;  // signed 64 bit, ns
inline constexpr uint32_t kEnd = kFeatures + 0x90;

inline constexpr uint32_t kXml = 0x100000;
}  // namespace reg

/// Values of registers that are enumerations.
namespace value {
inline constexpr uint32_t kModeContinuous = 1;
inline constexpr uint32_t kModeSingleFrame = 2;
inline constexpr uint32_t kSourceLine0 = 0;
inline constexpr uint32_t kSourceLine1 = 1;
inline constexpr uint32_t kSourceSoftware = 16;
inline constexpr uint32_t kRisingEdge = 0;
inline constexpr uint32_t kFallingEdge = 1;
inline constexpr uint32_t kPtpListening = 4;
inline constexpr uint32_t kPtpDisabled = 3;
inline constexpr uint32_t kPtpUncalibrated = 8;
inline constexpr uint32_t kPtpSlave = 9;
inline constexpr uint32_t kExclusiveAccess = 1;
inline constexpr uint32_t kControlAccess = 2;
inline constexpr uint32_t kFireTestPacket = 0x80000000;
inline constexpr uint32_t kLatchTimestamp = 2;
}  // namespace value

/// The memory of a camera: registers and, from reg::kXml on, the description of its features.
/// Addresses that a GVCP request brings are checked with Contains() first.
class RegisterMap {
 public:
  explicit RegisterMap(std::string_view xml);

  bool Contains(uint32_t address, size_t size) const;
  Bytes Read(uint32_t address, size_t size) const;  // bytes that are not there are 0

  uint32_t Get(uint32_t address) const;
  uint64_t Get64(uint32_t address) const;
  double GetFloat(uint32_t address) const;
  void Set(uint32_t address, uint32_t value);
  void Set64(uint32_t address, uint64_t value);
  void SetFloat(uint32_t address, double value);
  /// At most `size` bytes of `text`, padded with zeros; the last one is always zero.
  void SetText(uint32_t address, std::string_view text, size_t size);
  void SetBytes(uint32_t address, std::span<const uint8_t> bytes);

 private:
  Bytes memory_;          // registers
  std::string_view xml_;  // of a string that outlives every camera
};

}  // namespace rotunda::sim
