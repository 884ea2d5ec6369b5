#include "daemon/http_bulk.h"

#include <algorithm>

namespace rotunda::daemon {
namespace {

// Of the handlers' threads: one may be held up by a camera or a file that is looked at for the
// status, the other answers.
constexpr int kNeverBulk = 2;

}  // namespace

BulkQueue::BulkQueue(net::io_context& io, net::thread_pool& handlers, int threads)
    : io_(io), handlers_(handlers), most_(std::max(1, threads - kNeverBulk)) {}

void BulkQueue::Do(Bulk bulk) {
  waiting_.push_back(std::move(bulk));
  Next();
}

void BulkQueue::Next() {
  if (waiting_.empty() || running_ >= most_) return;
  ++running_;
  net::post(handlers_, [this, work = std::move(waiting_.front().work)]() mutable {
    work();
    net::post(io_, [this, done = std::move(work)] {  // and its connection, to where that may end
      --running_;
      Next();
    });
  });
  waiting_.pop_front();
}

void BulkQueue::GiveUpLate() {
  // All are as patient: the first waits the longest.
  while (!waiting_.empty() && waiting_.front().patience < Clock::now()) {
    const Bulk late = std::move(waiting_.front());
    waiting_.pop_front();
    late.give_up();
  }
}

}  // namespace rotunda::daemon
