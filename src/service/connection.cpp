#include "service/connection.hpp"

#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>

#include "service/files.hpp"

namespace sweepvi::service {

Connection::Connection(socket_t socket, const RequestLimits& limits) : socket_(socket), limits_(limits) {}

bool Connection::wait_for(short events, double seconds) const {
  pollfd state{socket_, events, 0};
  const int found = poll(&state, 1, static_cast<int>(std::max(0.0, seconds) * 1e3));
  return found > 0 && (state.revents & (events | POLLHUP)) != 0;
}

bool Connection::next() {
  if (first_ == last_ && !wait_for(POLLIN, limits_.idle)) return false;
  began_ = ticks();
  bytes_ = 0;
  head_bytes_ = 0;
  line_ends_ = 0;
  return true;
}

bool Connection::is_readable() const {
  return first_ < last_ || wait_for(POLLIN, 0.0);
}

bool Connection::is_writable() const {
  return wait_for(POLLOUT, 0.0);
}

void Connection::follow_head(const char* bytes, std::size_t size) {
  for (std::size_t i = 0; i < size && line_ends_ < 2; ++i) {
    if (bytes[i] == '\n')
      ++line_ends_;
    else if (bytes[i] != '\r')
      line_ends_ = 0;
  }
}

ssize_t Connection::read(char* bytes, std::size_t size) {
  const bool in_head = line_ends_ < 2;
  const auto most = static_cast<std::int64_t>(limits_.head) + (in_head ? 0 : limits_.body);
  if (bytes_ >= most) return -1;
  if (first_ == last_) {
    const double until = began_ + limits_.patience + static_cast<double>(bytes_) / limits_.slowest;
    if (!wait_for(POLLIN, until - ticks())) return -1;
    const ssize_t count = recv(socket_, buffer_.data(), buffer_.size(), 0);
    if (count <= 0) return count;
    first_ = 0;
    last_ = static_cast<std::size_t>(count);
  }
  const std::size_t taken = std::min(size, last_ - first_);
  std::memcpy(bytes, buffer_.data() + first_, taken);
  first_ += taken;
  bytes_ += static_cast<std::int64_t>(taken);
  if (in_head) head_bytes_ += static_cast<std::int64_t>(taken);  // which is read byte by byte
  follow_head(bytes, taken);
  return static_cast<ssize_t>(taken);
}

ssize_t Connection::write(const char* bytes, std::size_t size) {
  if (!wait_for(POLLOUT, limits_.stalled)) return -1;
  return send(socket_, bytes, size, MSG_NOSIGNAL);
}

void Connection::finish() {
  shutdown(socket_, SHUT_WR);
  constexpr double moment = 0.5;  // s
  const double until = ticks() + moment;
  while (wait_for(POLLIN, until - ticks()) && recv(socket_, buffer_.data(), buffer_.size(), 0) > 0) {
  }
  close(socket_);
}

void Connection::get_remote_ip_and_port(std::string& ip, int& port) const {
  ip.clear();
  port = 0;
}

void Connection::get_local_ip_and_port(std::string& ip, int& port) const {
  ip.clear();
  port = 0;
}

bool Server::process_and_close_socket(socket_t socket) {
  Connection connection(socket, limits_);
  bool good = false;
  try {
    // Nobody else serves this connection: a client that keeps it may not keep the thread for ever.
    for (std::size_t left = keep_alive_max_count_; left > 0 && svr_sock_ != INVALID_SOCKET; --left) {
      if (!connection.next()) break;
      bool closed = false;
      std::string announced;
      bool in_chunks = false;
      // Ranges are ours: cpp-httplib 0.11 applies them to every answer, and does not compare them with sizes.
      good = process_request(connection, left == 1, closed, [&](httplib::Request& request) {
        request.ranges.clear();
        announced = request.get_header_value("Content-Length");
        in_chunks = request.has_header("Transfer-Encoding");
      });
      // What nobody read of a body shall not be taken for the next request.
      const bool all_read =
          !in_chunks && std::strtoll(announced.c_str(), nullptr, 10) == connection.body_bytes();
      if (!good || closed || !all_read) break;
    }
  } catch (const std::exception&) {  // of a request that its parser cannot take
    good = false;
  }
  connection.finish();
  return good;
}

}  // namespace sweepvi::service
