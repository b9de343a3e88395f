#pragma once

#include <hdf5.h>

#include <string>
#include <utility>

namespace sweepvi {

/// Owns one HDF5 identifier. Move-only; empty after a move. An identifier below 0, HDF5's sign of failure, is
/// an empty handle. Closing files and datasets that were opened with MPI is collective.
template <auto Close>
class Hdf5Handle {
public:
  Hdf5Handle() = default;
  explicit Hdf5Handle(hid_t id) noexcept : id_(id) {}
  Hdf5Handle(Hdf5Handle&& other) noexcept : id_(std::exchange(other.id_, H5I_INVALID_HID)) {}
  Hdf5Handle& operator=(Hdf5Handle&& other) noexcept {
    Hdf5Handle taken(std::move(other));
    std::swap(id_, taken.id_);  // our old identifier is closed here
    return *this;
  }
  ~Hdf5Handle() { close(); }

  hid_t get() const noexcept { return id_; }
  explicit operator bool() const noexcept { return id_ >= 0; }
  /// Lets go without closing.
  void release() noexcept { id_ = H5I_INVALID_HID; }
  /// Closes now, for callers who need to know whether that went well.
  herr_t close() noexcept { return id_ >= 0 ? Close(std::exchange(id_, H5I_INVALID_HID)) : 0; }

private:
  hid_t id_ = H5I_INVALID_HID;
};

using Hdf5File = Hdf5Handle<H5Fclose>;
using Hdf5Object = Hdf5Handle<H5Oclose>;
using Hdf5Dataset = Hdf5Handle<H5Dclose>;
using Hdf5Attribute = Hdf5Handle<H5Aclose>;
using Hdf5Space = Hdf5Handle<H5Sclose>;
using Hdf5Type = Hdf5Handle<H5Tclose>;
using Hdf5Properties = Hdf5Handle<H5Pclose>;

/// Keeps HDF5 from printing its error stack while in scope; we tell the user ourselves.
class QuietHdf5 {
public:
  QuietHdf5() {
    H5Eget_auto2(H5E_DEFAULT, &print_, &data_);
    H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
  }
  ~QuietHdf5() { H5Eset_auto2(H5E_DEFAULT, print_, data_); }
  QuietHdf5(const QuietHdf5&) = delete;
  QuietHdf5& operator=(const QuietHdf5&) = delete;

private:
  H5E_auto2_t print_ = nullptr;
  void* data_ = nullptr;
};

/// The innermost message of the HDF5 call that failed last on this rank: the most specific there is. Of all
/// that HDF5 tells of a failed system call, only what the system said.
inline std::string hdf5_reason() {
  std::string reason;
  const auto first = [](unsigned depth, const H5E_error2_t* error, void* found) -> herr_t {
    if (depth == 0 && error->desc) *static_cast<std::string*>(found) = error->desc;
    return 0;
  };
  H5Ewalk2(H5E_DEFAULT, H5E_WALK_UPWARD, first, &reason);
  while (!reason.empty() && (reason.back() == '\n' || reason.back() == ' '))
    reason.pop_back();
  const std::string begin = "error message = '";
  if (const std::size_t at = reason.find(begin); at != std::string::npos)
    reason = reason.substr(at + begin.size(), reason.find('\'', at + begin.size()) - at - begin.size());
  return reason.empty() ? "HDF5 gave no reason" : reason;
}

}  // namespace sweepvi
