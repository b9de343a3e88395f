#include "service/service.hpp"

#include <fmt/format.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <stdexcept>
#include <thread>

#include "io/printable.hpp"
#include "service/refusal.hpp"
#include "service/representation.hpp"

namespace sweepvi::service {

namespace {

constexpr int spare_threads = 4;  // for who neither hands in a job nor listens to one

int processors() {
  return static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
}

RequestLimits limits_of(const Settings& settings) {
  RequestLimits limits;
  limits.body = settings.body + static_cast<std::int64_t>(limits.head);  // what multipart adds
  return limits;
}

std::unique_ptr<Launcher> make_launcher(const Settings& settings, const std::string& queue) {
  if (settings.launcher == "slurm") return make_slurm_launcher(settings, queue);
  return make_local_launcher(settings);
}

void refuse(httplib::Response& response, int status, const std::string& message) {
  response.status = status;
  response.body.clear();
  response.set_content(text_of({{"error", message}}), "application/json");
  if (status == 401) response.set_header("WWW-Authenticate", "Bearer");
}

}  // namespace

Service::Service(const Settings& settings)
    : settings_(settings),
      store_(settings.data),
      queue_(sound_queue(store_).string(), store_.queue_name()),
      access_(settings),
      launcher_(make_launcher(settings_, queue_.name())),
      checks_(processors()),
      server_(limits_of(settings), static_cast<std::size_t>(settings.threads + spare_threads)) {
  take_up(store_, queue_);
  scheduler_ = std::make_unique<Scheduler>(queue_, store_, settings_, *launcher_);
  server_.set_keep_alive_max_count(1000);
  server_.set_payload_max_length(static_cast<std::size_t>(settings_.body));
  server_.set_tcp_nodelay(!settings_.on_socket());
  set_answers();
  set_routes();
}

void Service::set_answers() {
  server_.set_default_headers(
      {{"X-Content-Type-Options", "nosniff"},
       {"Content-Security-Policy",
        "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; connect-src 'self'; "
        "img-src blob: data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"}});
  server_.set_pre_routing_handler([this](const httplib::Request& request, httplib::Response& response) {
    try {
      access_.check(request);
      const std::string encoding = request.get_header_value("Content-Encoding");
      if (!encoding.empty() && encoding != "identity")
        throw Refusal(415, "bodies are taken as they are, without a Content-Encoding");
    } catch (const Refusal& refusal) {
      refuse(response, refusal.status(), refusal.what());
      return httplib::Server::HandlerResponse::Handled;
    }
    return httplib::Server::HandlerResponse::Unhandled;
  });
  server_.set_exception_handler(
      [](const httplib::Request&, httplib::Response& response, std::exception_ptr thrown) {
        try {
          std::rethrow_exception(std::move(thrown));
        } catch (const Refusal& refusal) {
          refuse(response, refusal.status(), refusal.what());
        } catch (const std::exception& error) {
          std::fprintf(stderr, "sweepvi-serve: %s\n", printable(error.what()).c_str());
          if (for_want_of_room(error)) return refuse(response, 507, "there is no room on the disk");
          refuse(response, 500, "internal error; the daemon's log says more");
        }
      });
  server_.set_error_handler([](const httplib::Request&, httplib::Response& response) {
    if (response.body.empty())
      refuse(response, response.status,
             response.status == 404 ? "there is nothing here; see /openapi.json"
                                    : fmt::format("the request cannot be taken (HTTP {})", response.status));
  });
}

void Service::stop() {
  ends_ = true;
  while (!server_.is_running())  // or the word would be lost
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  server_.stop();
}

void Service::listen() {
  if (!settings_.on_loopback())
    std::fprintf(stderr,
                 "sweepvi-serve: %s is open to the network, and what goes over it is not encrypted: "
                 "put a proxy with TLS in front of it\n",
                 settings_.listen.c_str());
  std::string where = settings_.listen;
  int socket = -1;
  server_.set_socket_options([&socket](int own) {
    socket = own;
    const int yes = 1;  // not for two daemons at once, as cpp-httplib would have it
    setsockopt(own, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
  });
  if (settings_.on_socket()) {
    const std::string path = settings_.listen.substr(5);
    // Of an earlier daemon; the lock of --data says that it is gone.
    if (std::filesystem::is_socket(path)) unlink(path.c_str());
    server_.set_address_family(AF_UNIX);
    constexpr int any = 80;
    if (!server_.bind_to_port(path, any)) throw std::runtime_error(path + ": cannot listen there");
    chmod(path.c_str(), 0600);
  } else {
    int port = settings_.port();
    if (port == 0)
      port = server_.bind_to_any_port(settings_.host());
    else if (!server_.bind_to_port(settings_.host(), port))
      port = -1;
    if (port < 0) throw std::runtime_error(settings_.listen + ": cannot listen there; is the port taken?");
    where = fmt::format("http://{}:{}", settings_.listen.substr(0, settings_.listen.rfind(':')), port);
  }
  ::listen(socket, SOMAXCONN);  // cpp-httplib lets five wait to be taken, and the system drops the sixth
  fmt::print("{}: {}; everything is kept in {}\n", where, launcher_->describe(), settings_.data.string());
  std::fflush(stdout);
  server_.listen_after_bind();
  if (!ends_) throw std::runtime_error(where + ": no more connections can be taken");
}

}  // namespace sweepvi::service
