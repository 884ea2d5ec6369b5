#include "daemon/events.h"

#include <utility>

namespace rotunda::daemon {

EventHub::Subscription::~Subscription() {
  const std::lock_guard lock(hub_->mutex_);
  hub_->listeners_.erase(key_);
}

std::unique_ptr<EventHub::Subscription> EventHub::Subscribe(Listener listener) {
  const std::lock_guard lock(mutex_);
  const uint64_t key = ++last_key_;
  listeners_.emplace(key, std::move(listener));
  return std::make_unique<Subscription>(this, key);
}

void EventHub::Publish(const std::vector<EventRecord>& events) {
  const std::lock_guard lock(mutex_);
  for (const EventRecord& event : events) {
    for (const auto& [key, listener] : listeners_) listener(event);
  }
}

}  // namespace rotunda::daemon
