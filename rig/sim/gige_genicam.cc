#include "rig/sim/gige_genicam.h"

#include <algorithm>
#include <map>
#include <sstream>

#include "rig/bandwidth.h"
#include "rig/sim/gige_registers.h"
#include "rig/sim/served_image.h"

namespace rotunda::sim {
namespace {

using Kind = Feature::Kind;
using Access = Feature::Access;

// What the limits of a real sensor of this kind would be.
constexpr double kMaxSide_px = 16384;
constexpr double kMinExposure_us = 10;
constexpr double kMaxExposure_us = 1e6;
constexpr double kMaxGain_dB = 24;
constexpr double kMaxTriggerDelay_us = 1e6;
constexpr double kMaxRate_hz = 60;
constexpr double kMinRate_hz = 0.1;
constexpr double kMinHeartbeat_ms = 500;
constexpr double kMaxHeartbeat_ms = 60000;
constexpr double kMaxPacketDelay_ticks = 1e8;

Feature Text(const char* category, const char* name, uint32_t address, uint32_t bytes) {
  return {.kind = Kind::kText,
          .category = category,
          .name = name,
          .address = address,
          .access = Access::kReadOnly,
          .bytes = bytes};
}

Feature ReadInteger(const char* category, const char* name, uint32_t address) {
  return {.category = category, .name = name, .address = address, .access = Access::kReadOnly};
}

Feature ReadInteger64(const char* category, const char* name, uint32_t address) {
  return {.kind = Kind::kInteger64,
          .category = category,
          .name = name,
          .address = address,
          .access = Access::kReadOnly,
          .bytes = 8};
}

Feature Integer(const char* category, const char* name, uint32_t address, double min, double max) {
  return {.category = category, .name = name, .address = address, .min = min, .max = max};
}

Feature Float(const char* category, const char* name, uint32_t address, double min, double max,
              const char* unit) {
  return {.kind = Kind::kFloat,
          .category = category,
          .name = name,
          .address = address,
          .min = min,
          .max = max,
          .unit = unit,
          .bytes = 8};
}

Feature Command(const char* category, const char* name, uint32_t address, uint32_t command) {
  return {.kind = Kind::kCommand,
          .category = category,
          .name = name,
          .address = address,
          .access = Access::kWriteOnly,
          .command = command};
}

Feature Enumeration(const char* category, const char* name, uint32_t address,
                    std::vector<std::pair<const char*, uint32_t>> entries) {
  return {.kind = Kind::kEnumeration,
          .category = category,
          .name = name,
          .address = address,
          .entries = std::move(entries)};
}

Feature Boolean(const char* category, const char* name, uint32_t address, Access access,
                double max) {
  return {.kind = Kind::kBoolean,
          .category = category,
          .name = name,
          .address = address,
          .access = access,
          .max = max};
}

Feature Locked(Feature feature) {
  feature.locked = true;
  return feature;
}

Feature ReadOnly(Feature feature) {
  feature.access = Access::kReadOnly;
  return feature;
}

void AddDevice(std::vector<Feature>& all) {
  const char* c = "DeviceControl";
  all.push_back(Text(c, "DeviceVendorName", reg::kVendorName, 32));
  all.push_back(Text(c, "DeviceModelName", reg::kModelName, 32));
  all.push_back(Text(c, "DeviceManufacturerInfo", reg::kManufacturerInfo, 48));
  all.push_back(Text(c, "DeviceVersion", reg::kDeviceVersion, 32));
  all.push_back(Text(c, "DeviceFirmwareVersion", reg::kDeviceVersion, 32));
  all.push_back(Text(c, "DeviceSerialNumber", reg::kSerialNumber, 16));
  all.push_back(Text(c, "DeviceUserID", reg::kUserName, 16));
  all.back().access = Access::kReadWrite;
  all.push_back(ReadOnly(Float(c, "DeviceTemperature", reg::kTemperature, -40, 120, "C")));
  all.push_back(Command(c, "DeviceReset", reg::kDeviceReset, 1));
}

void AddImageFormat(std::vector<Feature>& all) {
  const char* c = "ImageFormatControl";
  all.push_back(ReadInteger(c, "SensorWidth", reg::kSensorWidth));
  all.push_back(ReadInteger(c, "SensorHeight", reg::kSensorHeight));
  all.push_back(ReadInteger(c, "WidthMax", reg::kSensorWidth));
  all.push_back(ReadInteger(c, "HeightMax", reg::kSensorHeight));
  all.push_back(Locked(Integer(c, "Width", reg::kWidth, 1, kMaxSide_px)));
  all.push_back(Locked(Integer(c, "Height", reg::kHeight, 1, kMaxSide_px)));
  all.push_back(Locked(Integer(c, "OffsetX", reg::kOffsetX, 0, kMaxSide_px)));
  all.push_back(Locked(Integer(c, "OffsetY", reg::kOffsetY, 0, kMaxSide_px)));
  std::vector<std::pair<const char*, uint32_t>> formats;
  for (const PixelFormat format : PixelFormats()) {
    formats.emplace_back(PixelFormatName(format), static_cast<uint32_t>(format));
  }
  all.push_back(Locked(Enumeration(c, "PixelFormat", reg::kPixelFormat, formats)));
  all.push_back(
      Boolean("ChunkDataControl", "ChunkModeActive", reg::kChunkMode, Access::kReadWrite, 0));
}

void AddAcquisition(std::vector<Feature>& all) {
  const char* c = "AcquisitionControl";
  all.push_back(Locked(Enumeration(
      c, "AcquisitionMode", reg::kAcquisitionMode,
      {{"Continuous", value::kModeContinuous}, {"SingleFrame", value::kModeSingleFrame}})));
  all.push_back(Command(c, "AcquisitionStart", reg::kAcquisition, 1));
  all.push_back(Command(c, "AcquisitionStop", reg::kAcquisition, 0));
  all.push_back(Float(c, "AcquisitionFrameRate", reg::kFrameRate, kMinRate_hz, kMaxRate_hz, "Hz"));
  all.push_back(Enumeration(c, "TriggerSelector", reg::kTriggerSelector, {{"FrameStart", 0}}));
  all.push_back(Enumeration(c, "TriggerMode", reg::kTriggerMode, {{"Off", 0}, {"On", 1}}));
  all.push_back(Enumeration(c, "TriggerSource", reg::kTriggerSource,
                            {{"Line0", value::kSourceLine0},
                             {"Line1", value::kSourceLine1},
                             {"Software", value::kSourceSoftware}}));
  all.push_back(
      Enumeration(c, "TriggerActivation", reg::kTriggerActivation,
                  {{"RisingEdge", value::kRisingEdge}, {"FallingEdge", value::kFallingEdge}}));
  all.push_back(Command(c, "TriggerSoftware", reg::kTriggerSoftware, 1));
  all.push_back(Boolean(c, "TriggerArmed", reg::kTriggerArmed, Access::kReadOnly, 1));
  all.push_back(Float(c, "TriggerDelay", reg::kTriggerDelay, 0, kMaxTriggerDelay_us, "us"));
  all.push_back(Enumeration(c, "ExposureMode", reg::kExposureMode, {{"Timed", 1}}));
  all.push_back(Enumeration(c, "ExposureAuto", reg::kExposureAuto,
                            {{"Off", 0}, {"Once", 1}, {"Continuous", 2}}));
  all.push_back(
      Float(c, "ExposureTime", reg::kExposureTime, kMinExposure_us, kMaxExposure_us, "us"));
  all.push_back(Float("AnalogControl", "Gain", reg::kGain, 0, kMaxGain_dB, "dB"));
  all.push_back(Enumeration("AnalogControl", "GainAuto", reg::kGainAuto,
                            {{"Off", 0}, {"Once", 1}, {"Continuous", 2}}));
}

void AddTransport(std::vector<Feature>& all) {
  const char* c = "TransportLayerControl";
  all.push_back(ReadInteger(c, "GevCurrentIPAddress", reg::kCurrentIp));
  all.push_back(Integer(c, "GevHeartbeatTimeout", reg::kHeartbeatTimeout, kMinHeartbeat_ms,
                        kMaxHeartbeat_ms));
  all.push_back(Integer(c, "GevCCP", reg::kControlPrivilege, 0, 3));
  all.push_back(ReadInteger64(c, "GevTimestampTickFrequency", reg::kTickFrequency));
  all.push_back(
      Command(c, "GevTimestampControlLatch", reg::kTimestampControl, value::kLatchTimestamp));
  all.push_back(ReadInteger64(c, "GevTimestampValue", reg::kTimestampLatched));
  all.push_back(Command(c, "TimestampLatch", reg::kTimestampControl, value::kLatchTimestamp));
  all.push_back(ReadInteger64(c, "TimestampLatchValue", reg::kTimestampLatched));
  all.push_back(Integer(c, "GevSCPHostPort", reg::kStreamPort, 0, 65535));
  all.push_back(Integer(c, "GevSCDA", reg::kStreamAddress, 0, 4294967295.0));
  all.push_back(Locked(Integer(c, "GevSCPSPacketSize", reg::kStreamPacketSize,
                               rig::kMinPacketSize_bytes, rig::kMaxPacketSize_bytes)));
  all.push_back(Integer(c, "GevSCPD", reg::kStreamPacketDelay, 0, kMaxPacketDelay_ticks));
  all.push_back(Boolean(c, "PtpEnable", reg::kPtpEnable, Access::kReadWrite, 1));
  all.push_back(ReadOnly(Enumeration(c, "PtpStatus", reg::kPtpStatus,
                                     {{"Disabled", value::kPtpDisabled},
                                      {"Listening", value::kPtpListening},
                                      {"Uncalibrated", value::kPtpUncalibrated},
                                      {"Slave", value::kPtpSlave}})));
  all.push_back(ReadInteger64(c, "PtpOffsetFromMaster", reg::kPtpOffset));
}

std::vector<Feature> MakeFeatures() {
  std::vector<Feature> all;
  AddDevice(all);
  AddImageFormat(all);
  AddAcquisition(all);
  AddTransport(all);
  return all;
}

const char* AccessText(Access access) {
  switch (access) {
    case Access::kReadOnly:
      return "RO";
    case Access::kWriteOnly:
      return "WO";
    default:
      return "RW";
  }
}

/// The node that a client sees of a number, and the register behind it.
void WriteNumber(const Feature& f, const char* node, const char* register_node, std::ostream& out) {
  out << "<" << node << " Name=\"" << f.name << "\" NameSpace=\"Standard\"><pValue>" << f.name
      << "Reg</pValue>";
  const std::string name = f.name;
  // A region lies on the sensor.
  if (name == "Width" || name == "Height") {
    out << "<Min>1</Min><pMax>" << name << "Limit</pMax>";
  } else if (name == "OffsetX" || name == "OffsetY") {
    out << "<Min>0</Min><pMax>" << name << "Limit</pMax>";
  } else if (f.max > f.min) {
    out << "<Min>" << f.min << "</Min><Max>" << f.max << "</Max>";
  }
  if (*f.unit) out << "<Unit>" << f.unit << "</Unit>";
  out << "</" << node << ">";
  out << "<" << register_node << " Name=\"" << f.name << "Reg\"><Address>" << f.address
      << "</Address><Length>" << f.bytes << "</Length><AccessMode>" << AccessText(f.access)
      << "</AccessMode><pPort>Device</pPort><Cachable>NoCache</Cachable>";
  if (f.kind != Kind::kFloat) {
    const bool is_signed = f.address == reg::kPtpOffset;
    out << "<Sign>" << (is_signed ? "Signed" : "Unsigned") << "</Sign>";
  }
  out << "<Endianess>BigEndian</Endianess></" << register_node << ">";
}

void WriteRegister(const Feature& f, std::ostream& out) {
  out << "<IntReg Name=\"" << f.name << "Reg\"><Address>" << f.address << "</Address><Length>"
      << f.bytes << "</Length><AccessMode>" << AccessText(f.access)
      << "</AccessMode><pPort>Device</pPort><Cachable>NoCache</Cachable><Sign>Unsigned</Sign>"
      << "<Endianess>BigEndian</Endianess></IntReg>";
}

void WriteFeature(const Feature& f, std::ostream& out) {
  switch (f.kind) {
    case Kind::kInteger:
    case Kind::kInteger64:
      return WriteNumber(f, "Integer", "IntReg", out);
    case Kind::kFloat:
      return WriteNumber(f, "Float", "FloatReg", out);
    case Kind::kText:
      out << "<StringReg Name=\"" << f.name << "\" NameSpace=\"Standard\"><Address>" << f.address
          << "</Address><Length>" << f.bytes << "</Length><AccessMode>" << AccessText(f.access)
          << "</AccessMode><pPort>Device</pPort></StringReg>";
      return;
    case Kind::kEnumeration:
      out << "<Enumeration Name=\"" << f.name << "\" NameSpace=\"Standard\">";
      for (const auto& [entry, code] : f.entries) {
        out << "<EnumEntry Name=\"" << entry << "\" NameSpace=\"Standard\"><Value>" << code
            << "</Value></EnumEntry>";
      }
      out << "<pValue>" << f.name << "Reg</pValue></Enumeration>";
      return WriteRegister(f, out);
    case Kind::kBoolean:
      out << "<Boolean Name=\"" << f.name << "\" NameSpace=\"Standard\"><pValue>" << f.name
          << "Reg</pValue><OnValue>1</OnValue><OffValue>0</OffValue></Boolean>";
      return WriteRegister(f, out);
    case Kind::kCommand:
      out << "<Command Name=\"" << f.name << "\" NameSpace=\"Standard\"><pValue>" << f.name
          << "Reg</pValue><CommandValue>" << f.command << "</CommandValue></Command>";
      return WriteRegister(f, out);
  }
}

/// Values that follow from others.
void WriteFormulas(std::ostream& out) {
  const auto formula = [&](const char* name, const std::vector<std::pair<char, const char*>>& of,
                           const char* text) {
    out << "<IntSwissKnife Name=\"" << name << "\" NameSpace=\"Standard\">";
    for (const auto& [letter, feature] : of) {
      out << "<pVariable Name=\"" << letter << "\">" << feature << "</pVariable>";
    }
    out << "<Formula>" << text << "</Formula></IntSwissKnife>";
  };
  formula("PayloadSize", {{'W', "Width"}, {'H', "Height"}, {'P', "PixelFormat"}},
          "W*H*((P&gt;&gt;16)&amp;0xFF)/8");
  formula("WidthLimit", {{'S', "SensorWidth"}, {'O', "OffsetXReg"}}, "S-O");
  formula("HeightLimit", {{'S', "SensorHeight"}, {'O', "OffsetYReg"}}, "S-O");
  formula("OffsetXLimit", {{'S', "SensorWidth"}, {'W', "WidthReg"}}, "S-W");
  formula("OffsetYLimit", {{'S', "SensorHeight"}, {'W', "HeightReg"}}, "S-W");
}

void WriteCategories(std::ostream& out) {
  std::map<std::string, std::vector<std::string>> names;
  for (const Feature& feature : Features()) names[feature.category].push_back(feature.name);
  names["ImageFormatControl"].push_back("PayloadSize");
  out << "<Category Name=\"Root\" NameSpace=\"Standard\">";
  for (const auto& [category, unused] : names) out << "<pFeature>" << category << "</pFeature>";
  out << "</Category>";
  for (const auto& [category, features] : names) {
    out << "<Category Name=\"" << category << "\" NameSpace=\"Standard\">";
    for (const std::string& name : features) out << "<pFeature>" << name << "</pFeature>";
    out << "</Category>";
  }
}

}  // namespace

const std::vector<Feature>& Features() {
  static const std::vector<Feature> features = MakeFeatures();
  return features;
}

const Feature* WritableAt(uint32_t address) {
  const auto found = std::find_if(Features().begin(), Features().end(), [&](const Feature& f) {
    return f.address == address && f.access != Access::kReadOnly;
  });
  return found == Features().end() ? nullptr : &*found;
}

std::string GenicamXml() {
  std::ostringstream out;
  out.precision(12);
  out << "<?xml version=\"1.0\" encoding=\"UTF-8\"?>"
      << "<RegisterDescription ModelName=\"SimulatedGigE\" VendorName=\"Rotunda\" "
      << "StandardNameSpace=\"GEV\" SchemaMajorVersion=\"1\" SchemaMinorVersion=\"1\" "
      << "SchemaSubMinorVersion=\"0\" MajorVersion=\"1\" MinorVersion=\"0\" "
      << "SubMinorVersion=\"0\" ProductGuid=\"5ca1ab1e-0000-4000-8000-726f74756e64\" "
      << "VersionGuid=\"5ca1ab1e-0001-4000-8000-726f74756e64\" "
      << "xmlns=\"http://www.genicam.org/GenApi/Version_1_1\">";
  WriteCategories(out);
  for (const Feature& feature : Features()) WriteFeature(feature, out);
  WriteFormulas(out);
  out << "<Integer Name=\"TLParamsLocked\" NameSpace=\"Standard\"><Value>0</Value><Min>0</Min>"
      << "<Max>1</Max></Integer><Port Name=\"Device\" NameSpace=\"Standard\"/>"
      << "</RegisterDescription>";
  return out.str();
}

}  // namespace rotunda::sim
