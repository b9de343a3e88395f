#pragma once

#include <string>

namespace sweepvi {

/// While in scope, a crash inside HDF5 ends the process with exit code 2 and one sentence that names the
/// file. HDF5 1.10 trusts what a damaged file says about itself: its readers can run over the end of a
/// buffer, divide by zero or free what is not theirs. Afterwards nothing in this process can be relied on, so
/// that nothing but write() and _exit() is called. One guard at a time; signal handlers belong to the whole
/// process.
class Hdf5Guard {
public:
  explicit Hdf5Guard(const std::string& file);
  ~Hdf5Guard();
  Hdf5Guard(const Hdf5Guard&) = delete;
  Hdf5Guard& operator=(const Hdf5Guard&) = delete;
};

}  // namespace sweepvi
