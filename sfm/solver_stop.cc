#include "sfm/solver_stop.h"

#include <ceres/iteration_callback.h>

#include <utility>

namespace rotunda::sfm {
namespace {

class StopCallback final : public ceres::IterationCallback {
 public:
  explicit StopCallback(std::stop_token stop) : stop_(std::move(stop)) {}
  ceres::CallbackReturnType operator()(const ceres::IterationSummary&) override {
    return stop_.stop_requested() ? ceres::SOLVER_ABORT : ceres::SOLVER_CONTINUE;
  }

 private:
  std::stop_token stop_;
};

}  // namespace

std::unique_ptr<ceres::IterationCallback> StopBetweenIterations(std::stop_token stop) {
  return std::make_unique<StopCallback>(std::move(stop));
}

}  // namespace rotunda::sfm
