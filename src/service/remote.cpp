#include "service/remote.hpp"

#include <fmt/format.h>
#include <sys/socket.h>

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <thread>

#include "io/output_file.hpp"
#include "service/digest.hpp"
#include "service/files.hpp"
#include "service/refusal.hpp"
#include "service/user.hpp"

namespace sweepvi::service {

using nlohmann::json;

namespace {

constexpr int bad_input = 2;
constexpr int no_answer = 1;
constexpr int not_written = 5;
constexpr double patience = 60.0;  // s until a server that went away is given up

std::string from_environment(const char* name, const std::string& otherwise) {
  const char* value = std::getenv(name);
  return value == nullptr || *value == '\0' ? otherwise : value;
}

std::unique_ptr<httplib::Client> connect(const std::string& server) {
  std::unique_ptr<httplib::Client> client;
  if (!server.starts_with("unix:/") && !server.starts_with("http://"))
    throw UsageError(fmt::format("--server {}: expected http://HOST:PORT or unix:/PATH", server));
  if (server.starts_with("unix:")) {
    constexpr int any = 80;
    client = std::make_unique<httplib::Client>(server.substr(5), any);
    client->set_address_family(AF_UNIX);
  } else {
    client = std::make_unique<httplib::Client>(server);
  }
  if (!client->is_valid())
    throw UsageError(fmt::format("--server {}: expected http://HOST:PORT or unix:/PATH", server));
  client->set_connection_timeout(10);
  client->set_read_timeout(120);
  client->set_write_timeout(120);
  client->set_keep_alive(true);
  client->set_tcp_nodelay(!server.starts_with("unix:"));
  return client;
}

/// Again for a while if nobody takes the connection: a daemon that is started anew takes a moment.
httplib::Result insist(const std::function<httplib::Result()>& ask) {
  constexpr double moment = 5.0;  // s
  const double begin = ticks();
  httplib::Result result = ask();
  while (!result && result.error() == httplib::Error::Connection && ticks() - begin < moment) {
    std::this_thread::sleep_for(std::chrono::milliseconds(200));
    result = ask();
  }
  return result;
}

}  // namespace

std::vector<Option> Remote::options() {
  return {
      {"--server", "URL", "http://HOST:PORT or unix:/PATH (default: $SWEEPVI_SERVER, http://127.0.0.1:8750)"},
      {"--token-file", "FILE", "the token to show (default: $SWEEPVI_TOKEN_FILE)"}};
}

Remote::Remote(const Arguments& given)
    : server_(given.get("--server", from_environment("SWEEPVI_SERVER", "http://127.0.0.1:8750"))),
      client_(connect(server_)) {
  const std::string file = given.get("--token-file", from_environment("SWEEPVI_TOKEN_FILE", ""));
  if (!file.empty()) headers_.emplace("Authorization", "Bearer " + read_token(file));
  if (server_.starts_with("unix:")) headers_.emplace("Host", "localhost");
}

json Remote::read(const httplib::Result& result, const std::string& path) const {
  if (!result)
    throw RemoteError(no_answer, fmt::format("{} does not answer ({}); is 'sweepvi serve' running there?",
                                             server_, httplib::to_string(result.error())));
  const json body = json::parse(result->body, nullptr, false);
  if (result->status < 300) return body.is_discarded() ? json() : body;
  const std::string said = body.is_object() ? body.value("error", "") : "";
  constexpr int first_of_server = 500;
  const int exit = body.is_object() && body.contains("exit") ? body.value("exit", bad_input)
                   : result->status >= first_of_server       ? no_answer
                                                             : bad_input;
  throw RemoteError(exit, said.empty() ? fmt::format("{}{}: HTTP {}", server_, path, result->status) : said);
}

json Remote::get(const std::string& path) {
  return read(insist([&] { return client_->Get(path, headers_); }), path);
}

json Remote::post(const std::string& path, const std::string& body, const std::string& type) {
  return read(
      insist([&] { return client_->Post(path, headers_, body, type.empty() ? "application/json" : type); }),
      path);
}

std::string Remote::text(const std::string& path) {
  const httplib::Result result = insist([&] { return client_->Get(path, headers_); });
  static_cast<void>(read(result, path));
  return result->body;
}

// With its key it may be sent as often as it takes.
json Remote::post_form(const std::string& path, const httplib::MultipartFormDataItems& parts,
                       const std::string& key) {
  httplib::Headers headers = headers_;
  headers.emplace("Idempotency-Key", key);
  const double begin = ticks();
  const auto ask = [&] { return insist([&] { return client_->Post(path, headers, parts); }); };
  httplib::Result result = ask();
  constexpr int busy = 503;
  const auto may_work_later = [&] {
    return result ? result->status == busy : result.error() != httplib::Error::Connection;
  };
  while (may_work_later() && ticks() - begin < patience) {
    std::this_thread::sleep_for(std::chrono::milliseconds(300));
    result = ask();
  }
  return read(result, path);
}

void Remote::listen(const std::string& path, const std::function<bool(const Event&)>& take) {
  std::string last;
  bool more = true;
  double heard = ticks();
  while (more) {
    httplib::Headers headers = headers_;
    if (!last.empty()) headers.emplace("Last-Event-ID", last);
    std::string text;
    int status = 0;
    std::string refusal;
    const httplib::Result result = client_->Get(
        path, headers,
        [&](const httplib::Response& response) {
          status = response.status;
          return true;
        },
        [&](const char* data, std::size_t size) {
          if (status != 200) {
            refusal.append(data, size);
            return true;
          }
          heard = ticks();
          text.append(data, size);
          for (std::size_t end = text.find("\n\n"); more && end != std::string::npos;
               end = text.find("\n\n")) {
            Event event;
            std::istringstream lines(text.substr(0, end));
            for (std::string line; std::getline(lines, line);) {
              if (line.starts_with("id: ")) event.id = line.substr(4);
              if (line.starts_with("event: ")) event.name = line.substr(7);
              if (line.starts_with("data: ")) event.data = line.substr(6);
            }
            text.erase(0, end + 2);
            if (event.name.empty()) continue;
            last = event.id;
            more = take(event);
          }
          return more;
        });
    constexpr int busy = 503;
    if (status != 200 && status != 0 && status != busy) {
      const json body = json::parse(refusal, nullptr, false);
      throw RemoteError(bad_input, body.is_object() ? body.value("error", "") : refusal);
    }
    if (!more) return;
    if (ticks() - heard > patience) static_cast<void>(read(result, path));
    if (ticks() - heard > patience) return;
    std::this_thread::sleep_for(std::chrono::milliseconds(300));
  }
}

void Remote::download(const std::string& path, const std::string& file) {
  const OutputTarget target = output_target(file);
  const bool whole_file = target.kind == OutputTarget::Kind::regular;
  const std::string part =
      whole_file ? target.path.string() + ".part"
                 : std::filesystem::temp_directory_path().string() + "/sweepvi-" + random_hex(8);
  std::ofstream out(part, std::ios::binary | std::ios::trunc);
  std::int64_t done = 0;
  std::string digest;
  std::string tag;
  double heard = ticks();
  while (true) {
    httplib::Headers headers = headers_;
    if (done > 0) {
      headers.emplace("Range", fmt::format("bytes={}-", done));
      headers.emplace("If-Range", tag);
    }
    int status = 0;
    std::string refusal;
    const httplib::Result result = client_->Get(
        path, headers,
        [&](const httplib::Response& response) {
          status = response.status;
          constexpr int whole = 200;
          if (status == whole && done > 0) {  // another file by now
            out.close();
            out.open(part, std::ios::binary | std::ios::trunc);
            done = 0;
          }
          if (status < 300) {
            digest = response.get_header_value("Repr-Digest");
            tag = response.get_header_value("ETag");
          }
          return true;
        },
        [&](const char* data, std::size_t size) {
          if (status >= 300) {
            refusal.append(data, size);
            return true;
          }
          heard = ticks();
          out.write(data, static_cast<std::streamsize>(size));
          done += static_cast<std::int64_t>(size);
          return static_cast<bool>(out);
        });
    if (!out) throw RemoteError(not_written, part + " cannot be written");
    if (status >= 300) {
      std::filesystem::remove(part);
      const json body = json::parse(refusal, nullptr, false);
      throw RemoteError(bad_input, body.is_object() ? body.value("error", "") : refusal);
    }
    if (result) break;
    if (ticks() - heard > patience) static_cast<void>(read(result, path));
    std::this_thread::sleep_for(std::chrono::milliseconds(300));
  }
  out.close();
  if (!out) throw RemoteError(not_written, part + " cannot be written");
  const std::string found = digest_of_file(part);
  if (tag != '"' + found + '"')
    throw RemoteError(
        no_answer, fmt::format("{} is not what the server has: it says {}, this is {}", part, digest, found));
  try {
    if (whole_file) return std::filesystem::rename(part, target.path);
    write_output(file, read_file(part).value_or(""));
    std::filesystem::remove(part);
  } catch (const std::system_error& error) {
    throw RemoteError(not_written, fmt::format("{}: {}", file, error.code().message()));
  }
}

}  // namespace sweepvi::service
