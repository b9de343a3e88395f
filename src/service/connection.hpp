#pragma once

#include <httplib.h>

#include <array>
#include <cstdint>
#include <string>

namespace sweepvi::service {

/// What one request may take of our time and memory before it is complete.
struct RequestLimits {
  std::size_t head = 64U << 10U;   ///< request line and headers [B]
  std::int64_t body = 1 << 20;     ///< [B]
  double patience = 20.0;          ///< for all of it, and [s] more for
  double slowest = 64.0 * 1024.0;  ///< each so many bytes
  double idle = 5.0;               ///< between requests [s]
  double stalled = 30.0;           ///< until somebody who does not read is given up [s]
};

/// A connection that gives up on clients who send too much, too slowly, or nothing: cpp-httplib bounds single
/// lines and pauses, not requests.
class Connection : public httplib::Stream {
public:
  Connection(socket_t socket, const RequestLimits& limits);

  /// Waits for the next request; false if there is none.
  bool next();
  /// Of the body of this request, as it was read so far.
  std::int64_t body_bytes() const { return bytes_ - head_bytes_; }
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
  bool wait_for(short events, double seconds) const;
  void follow_head(const char* bytes, std::size_t size);

  socket_t socket_;
  const RequestLimits& limits_;
  std::array<char, 16384> buffer_{};
  std::size_t first_ = 0, last_ = 0;  // of what is in the buffer and was not read
  double began_ = 0.0;
  std::int64_t bytes_ = 0;       // of this request so far
  std::int64_t head_bytes_ = 0;  // of them, up to the body
  int line_ends_ = 0;            // in a row; two end the head
};

/// cpp-httplib's server with such connections.
class Server : public httplib::Server {
public:
  explicit Server(RequestLimits limits) : limits_(limits) {}

private:
  bool process_and_close_socket(socket_t socket) override;

  RequestLimits limits_;
};

}  // namespace sweepvi::service
