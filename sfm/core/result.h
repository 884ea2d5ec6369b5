#pragma once

#include <cstdlib>
#include <string>
#include <utility>
#include <variant>

namespace rotunda {

enum class ErrorCode {
  kInvalidArgument,  // a value the caller gave is outside of what is allowed
  kBadInput,         // outside data (file, folder, picture, JSON) is not what it should be
  kNotFound,
  kAlreadyExists,
  kIo,         // the operating system refused: permission, disk full, ...
  kCancelled,  // the stop token was set
  kFailed,     // the work itself did not succeed: too few inliers, no initial pair, ...
};

/// What went wrong. `message` says what was found and what was expected; `context` names the file,
/// field or camera it is about (outermost first, joined by ": " in ToString).
struct Error {
  ErrorCode code = ErrorCode::kFailed;
  std::string message;
  std::string context;

  std::string ToString() const { return context.empty() ? message : context + ": " + message; }

  /// The same error, seen from one floor up: `outer` is put before the context.
  Error In(const std::string& outer) const {
    return {code, message, context.empty() ? outer : outer + ": " + context};
  }
};

/// A value or an Error. Reading the wrong side is a programming error and aborts.
template <typename T>
class [[nodiscard]] Result {
 public:
  Result(T value) : state_(std::in_place_index<0>, std::move(value)) {}
  Result(Error error) : state_(std::in_place_index<1>, std::move(error)) {}

  bool ok() const { return state_.index() == 0; }
  explicit operator bool() const { return ok(); }

  T& value() & { return Checked<0>(state_); }
  const T& value() const& { return Checked<0>(state_); }
  T&& value() && { return std::move(Checked<0>(state_)); }
  T& operator*() & { return value(); }
  const T& operator*() const& { return value(); }
  T&& operator*() && { return std::move(*this).value(); }
  T* operator->() { return &value(); }
  const T* operator->() const { return &value(); }

  const Error& error() const { return Checked<1>(state_); }

 private:
  template <size_t I, typename V>
  static auto& Checked(V& state) {
    if (state.index() != I) std::abort();
    return *std::get_if<I>(&state);
  }
  std::variant<T, Error> state_;
};

/// Success or an Error.
class [[nodiscard]] Status {
 public:
  Status() = default;
  Status(Error error) : error_(std::move(error)), ok_(false) {}
  bool ok() const { return ok_; }
  explicit operator bool() const { return ok_; }
  const Error& error() const {
    if (ok_) std::abort();
    return error_;
  }

 private:
  Error error_;
  bool ok_ = true;
};

/// Returns the error of `expr` from the enclosing function, if it has one.
#define ROTUNDA_RETURN_IF_ERROR(expr)                                                      \
  do {                                                                                     \
    if (auto rotunda_status = (expr); !rotunda_status.ok()) return rotunda_status.error(); \
  } while (false)

#define ROTUNDA_CONCAT_INNER(a, b) a##b
#define ROTUNDA_CONCAT(a, b) ROTUNDA_CONCAT_INNER(a, b)
/// `ROTUNDA_ASSIGN_OR_RETURN(auto x, F());` takes the value of F() or returns its error.
#define ROTUNDA_ASSIGN_OR_RETURN(declaration, expr)           \
  auto ROTUNDA_CONCAT(rotunda_result_, __LINE__) = (expr);    \
  if (!ROTUNDA_CONCAT(rotunda_result_, __LINE__).ok())        \
    return ROTUNDA_CONCAT(rotunda_result_, __LINE__).error(); \
  declaration = std::move(ROTUNDA_CONCAT(rotunda_result_, __LINE__)).value()

}  // namespace rotunda
