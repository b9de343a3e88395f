// The two functions that libFuzzer calls, around one reader of readers.hpp. Run by scripts/fuzz.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "readers.hpp"
#include "sweepvi/petsc.hpp"

namespace sweepvi::fuzz {

/// MPI and PETSc up for as long as the process lives; 20 MB of memory are there. Crashes are libFuzzer's to
/// report.
inline void start() {
  setenv("OMPI_MCA_opal_signal", "", 0);
  static const std::vector<std::string> words = {"-no_signal_handler", "-sweepvi_memory_limit", "0.02"};
  static const Session session("fuzz", words);
}

}  // namespace sweepvi::fuzz

#define SWEEPVI_FUZZ_TARGET(reader)                                                             \
  extern "C" int LLVMFuzzerInitialize(int*, char***) {                                          \
    sweepvi::fuzz::start();                                                                     \
    return 0;                                                                                   \
  }                                                                                             \
  extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {           \
    static const sweepvi::fuzz::Folder folder(MPI_COMM_SELF);                                   \
    static const bool ready = (sweepvi::fuzz::put_data(folder), true);                          \
    static_cast<void>(ready);                                                                   \
    sweepvi::fuzz::reader(folder, std::string_view(reinterpret_cast<const char*>(data), size)); \
    return 0;                                                                                   \
  }
