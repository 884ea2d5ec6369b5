#pragma once

#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <mutex>
#include <span>
#include <stop_token>
#include <utility>
#include <vector>

namespace rotunda::rig {

class FrameMemory;

/// Memory of one picture, lent by a FrameMemory and given back when this goes. Empty when
/// default-made or moved from.
class FrameBlock {
 public:
  FrameBlock() = default;
  FrameBlock(FrameBlock&& other) noexcept
      : owner_(std::exchange(other.owner_, nullptr)),
        bytes_(std::move(other.bytes_)),
        size_(std::exchange(other.size_, 0)) {}
  FrameBlock& operator=(FrameBlock&& other) noexcept;
  ~FrameBlock() { GiveBack(); }

  explicit operator bool() const { return bytes_ != nullptr; }
  uint8_t* data() const { return bytes_.get(); }
  size_t size() const { return size_; }

 private:
  friend class FrameMemory;
  FrameBlock(FrameMemory* owner, std::unique_ptr<uint8_t[]> bytes, size_t size)
      : owner_(owner), bytes_(std::move(bytes)), size_(size) {}
  void GiveBack();

  FrameMemory* owner_ = nullptr;
  std::unique_ptr<uint8_t[]> bytes_;
  size_t size_ = 0;
};

/// A bounded number of equal blocks: what capture may hold, on the way from cameras to disk. A
/// block is allocated when first needed and then kept for reuse, so that receiving pays for no page
/// faults and memory stays flat. Outlives its blocks. Safe to use from several threads.
class FrameMemory {
 public:
  FrameMemory(size_t blocks, size_t block_bytes) : blocks_(blocks), block_bytes_(block_bytes) {}
  /// Aborts when a block has not come back: a camera may be writing into it.
  ~FrameMemory();
  FrameMemory(const FrameMemory&) = delete;
  FrameMemory& operator=(const FrameMemory&) = delete;

  /// `count` blocks, or none when so many do not become free until `deadline` or `stop` is set.
  std::vector<FrameBlock> Take(size_t count, std::chrono::steady_clock::time_point deadline,
                               std::stop_token stop = {});

  /// Blocks taken from now on have `block_bytes` at least; those that are lent stay as they are.
  void Grow(size_t block_bytes);

  size_t block_bytes() const;
  /// The most this will hold, as large as blocks are now.
  size_t limit_bytes() const { return blocks_ * block_bytes(); }
  size_t lent() const;

 private:
  friend class FrameBlock;
  void Return(std::unique_ptr<uint8_t[]> bytes, size_t size);

  const size_t blocks_;
  mutable std::mutex mutex_;
  size_t block_bytes_;
  std::condition_variable_any returned_;
  std::vector<std::unique_ptr<uint8_t[]>> spare_;
  size_t lent_ = 0;
};

}  // namespace rotunda::rig
