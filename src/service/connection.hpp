#pragma once

#include <httplib.h>

#include <array>
#include <atomic>
#include <cstdint>
#include <string>

#include "service/files.hpp"

namespace sweepvi::service {

/// What one request may take of our time and memory before it is complete.
struct RequestLimits {
  std::size_t head = 64U << 10U;   ///< request line and headers [B]
  std::int64_t body = 1 << 20;     ///< [B]
  double patience = 20.0;          ///< for all of it, and [s] more for
  double slowest = 64.0 * 1024.0;  ///< each so many bytes
  double idle = 5.0;               ///< between requests [s]
  double stalled = 30.0;           ///< until somebody who does not read is given up [s]
  // The same where others wait for a thread: who has said nothing yet goes at once.
  double slow_head = 1.0;    ///< for the head [s]
  double slow_client = 5.0;  ///< without a byte, to or from it [s]
};

/// Calls of connections that wait for a thread to those that have one and do nothing with it.
class Calls {
public:
  Calls();
  /// Readable while there are some.
  int descriptor() const { return event_.get(); }
  void call();
  /// Takes one; false if there is none.
  bool take();
  /// Takes all but so many.
  void keep(int most);

private:
  Descriptor event_;
  std::atomic<int> count_ = 0;
};

/// A connection that gives up on clients who send too much, too slowly, or nothing: cpp-httplib bounds single
/// lines and pauses, not requests. Heads are held against the rules before cpp-httplib sees them, see
/// check_head().
class Connection : public httplib::Stream {
public:
  Connection(socket_t socket, const RequestLimits& limits, Calls& calls);

  /// Waits for the next request and reads its head; false if there is none, or none that can be answered.
  bool next();
  /// Of the body of this request, as it was read so far.
  std::int64_t body_bytes() const { return body_bytes_; }
  /// Ends it so that the last answer arrives: what is still coming in is read for a moment.
  void finish();

  bool is_readable() const override;
  bool is_writable() const override;
  ssize_t read(char* bytes, std::size_t size) override;
  ssize_t write(const char* bytes, std::size_t size) override;
  void get_remote_ip_and_port(std::string& ip, int& port) const override;
  void get_local_ip_and_port(std::string& ip, int& port) const override;
  socket_t socket() const override { return socket_; }

private:
  /// Until the socket is ready: false after `seconds`, or if somebody calls after `undisturbed` seconds.
  bool wait_for(short events, double seconds, double undisturbed) const;
  bool fill(double until, double undisturbed);
  bool read_head();
  void refuse(int status, const std::string& text);

  socket_t socket_;
  const RequestLimits& limits_;
  Calls& calls_;
  std::array<char, 16384> buffer_{};
  std::size_t first_ = 0, last_ = 0;  // of what is in the buffer and was not read
  std::string head_;
  std::size_t head_read_ = 0;
  double began_ = 0.0;
  std::int64_t body_bytes_ = 0;
  mutable bool gave_way_ = false;
};

/// cpp-httplib's server with such connections.
class Server : public httplib::Server {
public:
  /// @param threads  that serve connections, one each
  Server(const RequestLimits& limits, std::size_t threads);

private:
  bool process_and_close_socket(socket_t socket) override;

  RequestLimits limits_;
  Calls calls_;
};

}  // namespace sweepvi::service
