#pragma once

#include <string>

namespace sweepvi::service {

/// What is wrong with the head of a request; status 0: nothing.
struct HeadComplaint {
  int status = 0;
  std::string text;
};

/// Holds the head of a request (request line, headers, empty line) against RFC 9112, strictly: where two
/// readers could see different ends of a request, or different hosts, it is refused. Lines end in CRLF; names
/// are tokens with the colon right behind them; no line goes on in the next; there is one Host; there is at
/// most one of Content-Length, digits only, and Transfer-Encoding, which is `chunked`. A POST, PUT or PATCH
/// that announces no body has none (RFC 9112, 6.3): that is written into its head.
HeadComplaint check_head(std::string& head);

}  // namespace sweepvi::service
