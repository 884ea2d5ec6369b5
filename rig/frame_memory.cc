#include "rig/frame_memory.h"

#include <cstdlib>

namespace rotunda::rig {

FrameBlock& FrameBlock::operator=(FrameBlock&& other) noexcept {
  if (this != &other) {
    GiveBack();
    owner_ = std::exchange(other.owner_, nullptr);
    bytes_ = std::move(other.bytes_);
    size_ = std::exchange(other.size_, 0);
  }
  return *this;
}

void FrameBlock::GiveBack() {
  if (bytes_) owner_->Return(std::move(bytes_), size_);
  owner_ = nullptr;
}

FrameMemory::~FrameMemory() {
  if (lent_ > 0) std::abort();
}

std::vector<FrameBlock> FrameMemory::Take(size_t count,
                                          std::chrono::steady_clock::time_point deadline,
                                          std::stop_token stop) {
  std::vector<FrameBlock> taken;
  std::unique_lock lock(mutex_);
  const auto are_free = [&] { return lent_ + count <= blocks_; };
  if (!returned_.wait_until(lock, stop, deadline, are_free)) return taken;
  taken.reserve(count);
  for (size_t i = 0; i < count; ++i) {
    std::unique_ptr<uint8_t[]> bytes;
    if (spare_.empty()) {
      bytes = std::make_unique<uint8_t[]>(block_bytes_);
    } else {
      bytes = std::move(spare_.back());
      spare_.pop_back();
    }
    taken.push_back(FrameBlock(this, std::move(bytes), block_bytes_));
    ++lent_;
  }
  return taken;
}

void FrameMemory::Grow(size_t block_bytes) {
  const std::lock_guard lock(mutex_);
  if (block_bytes <= block_bytes_) return;
  block_bytes_ = block_bytes;
  spare_.clear();
}

size_t FrameMemory::block_bytes() const {
  const std::lock_guard lock(mutex_);
  return block_bytes_;
}

size_t FrameMemory::lent() const {
  const std::lock_guard lock(mutex_);
  return lent_;
}

void FrameMemory::Return(std::unique_ptr<uint8_t[]> bytes, size_t size) {
  {
    const std::lock_guard lock(mutex_);
    if (size == block_bytes_) spare_.push_back(std::move(bytes));  // else it is too small by now
    --lent_;
  }
  returned_.notify_all();
}

}  // namespace rotunda::rig
