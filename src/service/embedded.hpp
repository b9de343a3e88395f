#pragma once

#include <string>

/// Files that the program carries with it; made by CMake from src/service/page.html and openapi.json.
namespace sweepvi::service::embedded {

const std::string& page();
const std::string& openapi();

}  // namespace sweepvi::service::embedded
