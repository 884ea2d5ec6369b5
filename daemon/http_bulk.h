#pragma once

#include <deque>
#include <functional>

#include "daemon/http_asio.h"

// Private to the .cc files of the HTTP server.

namespace rotunda::daemon {

/// Work that reads files, and what to do instead when its turn does not come until `patience`.
/// `work` runs in a handler's thread, `give_up` in the input/output thread.
struct Bulk {
  std::function<void()> work;
  std::function<void()> give_up;
  Clock::time_point patience;
};

/// Gives such work to the handlers' threads, but to no more than some of them at a time: files that
/// hang leave the others free. Used in the input/output thread alone.
class BulkQueue {
 public:
  /// `threads`: how many `handlers` has. Both outlive the queue.
  BulkQueue(net::io_context& io, net::thread_pool& handlers, int threads);

  void Do(Bulk bulk);
  /// Of those that wait all that have waited too long.
  void GiveUpLate();
  /// Forgets those that wait.
  void Clear() { waiting_.clear(); }

 private:
  void Next();

  net::io_context& io_;
  net::thread_pool& handlers_;
  const int most_;
  // Connections that wait here go before the context that they hang on.
  std::deque<Bulk> waiting_;
  int running_ = 0;
};

}  // namespace rotunda::daemon
