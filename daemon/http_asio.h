#pragma once

#include <chrono>
#include <utility>
// <utility> must be there before Boost 1.74's Asio under C++20.
#include <boost/asio/io_context.hpp>
#include <boost/asio/local/stream_protocol.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/thread_pool.hpp>
#include <boost/asio/write.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>

// Private to the .cc files of the HTTP server: what they use of Boost.

namespace rotunda::daemon {

namespace net = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
using Protocol = net::local::stream_protocol;
using Socket = Protocol::socket;
using Stream = beast::basic_stream<Protocol>;
using Clock = std::chrono::steady_clock;

}  // namespace rotunda::daemon
