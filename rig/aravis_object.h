#pragma once

// For the aravis_*.cc files alone: their headers show types of Aravis, which no other file sees.

#include <arv.h>

#include <memory>
#include <string>

#include "sfm/core/result.h"

namespace rotunda::rig {

struct Unref {
  void operator()(gpointer object) const { g_object_unref(object); }
};
template <typename T>
using GObjectPtr = std::unique_ptr<T, Unref>;

/// Takes the GError of one call; clears it.
class GErrorSlot {
 public:
  GErrorSlot() = default;
  ~GErrorSlot() { g_clear_error(&error_); }
  GErrorSlot(const GErrorSlot&) = delete;
  GErrorSlot& operator=(const GErrorSlot&) = delete;

  GError** out() {
    g_clear_error(&error_);
    return &error_;
  }
  explicit operator bool() const { return error_ != nullptr; }
  /// The camera answered that the caller may not do this.
  bool IsDenied() const {
    return g_error_matches(error_, ARV_DEVICE_ERROR, ARV_DEVICE_ERROR_NOT_CONTROLLER) ||
           g_error_matches(error_, ARV_DEVICE_ERROR, ARV_DEVICE_ERROR_PROTOCOL_ERROR_ACCESS_DENIED);
  }
  std::string message() const { return error_ == nullptr ? "" : error_->message; }
  Error ToError(const std::string& what) const { return {ErrorCode::kFailed, message(), what}; }
  Status status(const std::string& what) const {
    return error_ == nullptr ? Status() : Status(ToError(what));
  }

 private:
  GError* error_ = nullptr;
};

}  // namespace rotunda::rig
