#include "rig/frame_memory.h"

namespace rotunda::rig {

FrameBlock& FrameBlock::operator=(FrameBlock&& other) noexcept {
  if (this != &other) {
    GiveBack();
    owner_ = std::exchange(other.owner_, nullptr);
    bytes_ = std::move(other.bytes_);
  }
  return *this;
}

size_t FrameBlock::size() const { return owner_ == nullptr ? 0 : owner_->block_bytes(); }

void FrameBlock::GiveBack() {
  if (bytes_) owner_->Return(std::move(bytes_));
  owner_ = nullptr;
}

std::vector<FrameBlock> FrameMemory::Take(size_t count,
                                          std::chrono::steady_clock::time_point deadline) {
  std::vector<FrameBlock> taken;
  std::unique_lock lock(mutex_);
  if (!returned_.wait_until(lock, deadline, [&] { return lent_ + count <= blocks_; })) return taken;
  taken.reserve(count);
  for (size_t i = 0; i < count; ++i) {
    std::unique_ptr<uint8_t[]> bytes;
    if (spare_.empty()) {
      bytes = std::make_unique<uint8_t[]>(block_bytes_);
    } else {
      bytes = std::move(spare_.back());
      spare_.pop_back();
    }
    taken.push_back(FrameBlock(this, std::move(bytes)));
  }
  lent_ += count;
  return taken;
}

size_t FrameMemory::lent() const {
  const std::lock_guard lock(mutex_);
  return lent_;
}

void FrameMemory::Return(std::unique_ptr<uint8_t[]> bytes) {
  {
    const std::lock_guard lock(mutex_);
    spare_.push_back(std::move(bytes));
    --lent_;
  }
  returned_.notify_all();
}

}  // namespace rotunda::rig
