#include "service/connection.hpp"

#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <mutex>
#include <system_error>

#include "service/framing.hpp"
#include "service/representation.hpp"

namespace sweepvi::service {

Calls::Calls() : event_(eventfd(0, EFD_SEMAPHORE | EFD_NONBLOCK | EFD_CLOEXEC)) {
  if (!event_) throw std::system_error(errno, std::generic_category(), "eventfd");
}

void Calls::call() {
  if (eventfd_write(event_.get(), 1) == 0) ++count_;
}

bool Calls::take() {
  eventfd_t value = 0;
  if (eventfd_read(event_.get(), &value) != 0) return false;
  --count_;
  return true;
}

void Calls::keep(int most) {
  while (count_ > most && take()) {
  }
}

Connection::Connection(socket_t socket, const RequestLimits& limits, Calls& calls)
    : socket_(socket), limits_(limits), calls_(calls) {}

bool Connection::wait_for(short events, double seconds, double undisturbed) const {
  const double begin = ticks();
  while (true) {
    const double passed = ticks() - begin;
    const bool polite = passed >= undisturbed;
    const double until = polite ? seconds : std::min(seconds, undisturbed);
    std::array<pollfd, 2> states{{{socket_, events, 0}, {polite ? calls_.descriptor() : -1, POLLIN, 0}}};
    const int milliseconds = static_cast<int>(std::ceil(std::max(0.0, until - passed) * 1e3));
    const int found = poll(states.data(), states.size(), milliseconds);
    if (found < 0 && errno != EINTR) return false;
    if (found > 0 && states[0].revents != 0) return (states[0].revents & (events | POLLHUP)) != 0;
    if (found > 0 && states[1].revents != 0 && calls_.take()) {
      gave_way_ = true;
      return false;
    }
    if (ticks() - begin >= seconds) return false;
  }
}

/// More bytes into the buffer, which is empty.
bool Connection::fill(double until, double undisturbed) {
  if (!wait_for(POLLIN, until - ticks(), undisturbed)) return false;
  const ssize_t count = recv(socket_, buffer_.data(), buffer_.size(), 0);
  first_ = 0;
  last_ = static_cast<std::size_t>(std::max<ssize_t>(count, 0));
  return count > 0;
}

bool Connection::next() {
  if (first_ == last_ && !fill(ticks() + limits_.idle, 0.0)) return false;
  began_ = ticks();
  head_.clear();
  head_read_ = 0;
  body_bytes_ = 0;
  return read_head();
}

bool Connection::read_head() {
  const double until = began_ + limits_.patience;
  int line_ends = 0;  // in a row; two end the head
  while (true) {
    while (first_ < last_ && line_ends < 2) {
      const char c = buffer_[first_++];
      if (head_.empty() && (c == '\r' || c == '\n'))
        continue;  // RFC 9112, 2.2: lines before it count for nothing
      head_ += c;
      line_ends = c == '\n' ? line_ends + 1 : c == '\r' ? line_ends : 0;
    }
    if (line_ends == 2) break;
    if (head_.size() > limits_.head) {
      refuse(431, "the head of the request is too long");
      return false;
    }
    if (fill(until, std::max(0.0, began_ + limits_.slow_head - ticks()))) continue;
    if (!head_.empty())
      refuse(ticks() < until && !gave_way_ ? 400 : 408, "the head of the request has no end");
    return false;
  }
  const HeadComplaint complaint = check_head(head_);
  if (complaint.status != 0) refuse(complaint.status, complaint.text);
  return complaint.status == 0;
}

void Connection::refuse(int status, const std::string& text) {
  const std::string body = text_of({{"error", text}});
  const std::string answer = "HTTP/1.1 " + std::to_string(status) +
                             " Refused"
                             "\r\nContent-Type: application/json\r\nConnection: close\r\nContent-Length: " +
                             std::to_string(body.size()) + "\r\n\r\n" + body;
  static_cast<void>(send(socket_, answer.data(), answer.size(), MSG_NOSIGNAL | MSG_DONTWAIT));
}

bool Connection::is_readable() const {
  return head_read_ < head_.size() || first_ < last_ || wait_for(POLLIN, 0.0, 1.0);
}

bool Connection::is_writable() const {
  return wait_for(POLLOUT, 0.0, 1.0);
}

ssize_t Connection::read(char* bytes, std::size_t size) {
  if (head_read_ < head_.size()) {
    const std::size_t taken = head_.copy(bytes, size, head_read_);
    head_read_ += taken;
    return static_cast<ssize_t>(taken);
  }
  if (body_bytes_ >= limits_.body) return -1;
  const double until = began_ + limits_.patience + static_cast<double>(body_bytes_) / limits_.slowest;
  if (first_ == last_ && !fill(until, limits_.slow_client)) return -1;
  const std::size_t taken = std::min(size, last_ - first_);
  std::memcpy(bytes, buffer_.data() + first_, taken);
  first_ += taken;
  body_bytes_ += static_cast<std::int64_t>(taken);
  return static_cast<ssize_t>(taken);
}

ssize_t Connection::write(const char* bytes, std::size_t size) {
  if (!wait_for(POLLOUT, limits_.stalled, limits_.slow_client)) return -1;
  return send(socket_, bytes, size, MSG_NOSIGNAL);
}

void Connection::finish() {
  shutdown(socket_, SHUT_WR);
  constexpr double moment = 0.5;  // s
  const double until = ticks() + moment;
  while (!gave_way_ && wait_for(POLLIN, until - ticks(), 0.0) &&
         recv(socket_, buffer_.data(), buffer_.size(), 0) > 0) {
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

namespace {

/// Where all threads are busy, each connection more calls those that are idle.
class Pool : public httplib::ThreadPool {
public:
  Pool(std::size_t threads, Calls& calls)
      : httplib::ThreadPool(threads), threads_(static_cast<int>(threads)), calls_(calls) {}

  void enqueue(std::function<void()> work) override {
    {
      const std::lock_guard lock(mutex_);
      if (there_++ >= threads_) calls_.call();
    }
    httplib::ThreadPool::enqueue([this, own = std::move(work)] {
      {
        const std::lock_guard lock(mutex_);
        calls_.keep(std::max(0, there_ - threads_));  // who has a thread calls no more
      }
      own();
      const std::lock_guard lock(mutex_);
      --there_;
    });
  }

private:
  int threads_;
  Calls& calls_;
  std::mutex mutex_;
  int there_ = 0;  // connections, with a thread or without
};

}  // namespace

Server::Server(const RequestLimits& limits, std::size_t threads) : limits_(limits) {
  new_task_queue = [this, threads] { return new Pool(threads, calls_); };
}

bool Server::process_and_close_socket(socket_t socket) {
  Connection connection(socket, limits_, calls_);
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
