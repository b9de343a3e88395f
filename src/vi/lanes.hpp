#pragma once

#include <cstddef>

#include "vi/block_kernels.hpp"

// Included by each file of kernels, which may be compiled for other processors than the rest: nothing here
// has a name beyond that file, and nothing of the standard library is instantiated.
// NOLINTBEGIN(cert-dcl59-cpp,cppcoreguidelines-pro-type-member-init,modernize-loop-convert): as said; numbers
// are filled where they are made
namespace sweepvi {
namespace {

/// Eight doubles that are computed side by side. Sums are in the same order whatever the processor.
class Lanes {
public:
  static constexpr int width = BlockKernels::together;
#ifdef __AVX2__
  using Part = double __attribute__((vector_size(32)));
#else
  using Part = double __attribute__((vector_size(16)));  // what every x86-64 and ARMv8 has
#endif
  using MaskPart = decltype(Part{} < Part{});
  static constexpr int part_width = static_cast<int>(sizeof(Part) / sizeof(double));
  static constexpr int parts = width / part_width;

  struct Mask {
    MaskPart part[parts];  // NOLINT: no std::array of vector types
    void operator|=(const Mask& other) {
      for (int k = 0; k < parts; ++k)
        part[k] |= other.part[k];
    }
    Mask operator&(const Mask& other) const {
      Mask result;  // NOLINT: filled here, as all below
      for (int k = 0; k < parts; ++k)
        result.part[k] = part[k] & other.part[k];
      return result;
    }
    bool any() const {
      MaskPart all = part[0];
      for (int k = 1; k < parts; ++k)
        all |= part[k];
      return bits_of(all) != 0;
    }
    /// That of the first lane is the lowest.
    unsigned bits() const {
      unsigned result = 0;
      for (int k = 0; k < parts; ++k)
        result |= bits_of(part[k]) << (k * part_width);
      return result;
    }
    static unsigned bits_of(const MaskPart& lanes) {
#if defined(__AVX2__)
      return static_cast<unsigned>(__builtin_ia32_movmskpd256(reinterpret_cast<Part>(lanes)));
#elif defined(__SSE2__)
      return static_cast<unsigned>(__builtin_ia32_movmskpd(reinterpret_cast<Part>(lanes)));
#else
      unsigned result = 0;
      for (int lane = 0; lane < part_width; ++lane)
        result |= (lanes[lane] != 0 ? 1U : 0U) << lane;
      return result;
#endif
    }
  };

  Lanes() = default;
  Lanes(double all) {  // NOLINT(google-explicit-constructor): a number stands for as many equal ones
    for (Part& each : part_)
      each = all - Part{};
  }

  Lanes operator+(const Lanes& b) const {
    Lanes result;
    for (int k = 0; k < parts; ++k)
      result.part_[k] = part_[k] + b.part_[k];
    return result;
  }
  Lanes operator-(const Lanes& b) const {
    Lanes result;
    for (int k = 0; k < parts; ++k)
      result.part_[k] = part_[k] - b.part_[k];
    return result;
  }
  Lanes operator*(const Lanes& b) const {
    Lanes result;
    for (int k = 0; k < parts; ++k)
      result.part_[k] = part_[k] * b.part_[k];
    return result;
  }
  Lanes operator/(const Lanes& b) const {
    Lanes result;
    for (int k = 0; k < parts; ++k)
      result.part_[k] = part_[k] / b.part_[k];
    return result;
  }
  Mask operator<(const Lanes& b) const {
    Mask result;  // NOLINT
    for (int k = 0; k < parts; ++k)
      result.part[k] = part_[k] < b.part_[k];
    return result;
  }
  Mask operator<=(const Lanes& b) const {
    Mask result;  // NOLINT
    for (int k = 0; k < parts; ++k)
      result.part[k] = part_[k] <= b.part_[k];
    return result;
  }
  Mask operator==(const Lanes& b) const {
    Mask result;  // NOLINT
    for (int k = 0; k < parts; ++k)
      result.part[k] = part_[k] == b.part_[k];
    return result;
  }
  /// Not a <= b: also where a number is none.
  static Mask not_ordered(const Lanes& a, const Lanes& b) {
    Mask result;  // NOLINT
    for (int k = 0; k < parts; ++k)
      result.part[k] = ~(a.part_[k] <= b.part_[k]);
    return result;
  }
  Lanes absolute() const {
    Lanes result;
    for (int k = 0; k < parts; ++k)
      result.part_[k] =
          reinterpret_cast<Part>(reinterpret_cast<MaskPart>(part_[k]) & ((MaskPart{} - 1) ^ sign_bit()));
    return result;
  }
  /// The larger one and the smaller one; `a` where a number is none.
  static Lanes larger(const Lanes& a, const Lanes& b) {
    Lanes result;
    for (int k = 0; k < parts; ++k)
      result.part_[k] = a.part_[k] < b.part_[k] ? b.part_[k] : a.part_[k];
    return result;
  }
  static Lanes smaller(const Lanes& a, const Lanes& b) {
    Lanes result;
    for (int k = 0; k < parts; ++k)
      result.part_[k] = b.part_[k] < a.part_[k] ? b.part_[k] : a.part_[k];
    return result;
  }
  static Lanes choose(const Mask& mask, const Lanes& a, const Lanes& b) {
    Lanes result;
    for (int k = 0; k < parts; ++k)
      result.part_[k] = mask.part[k] ? a.part_[k] : b.part_[k];
    return result;
  }
  double operator[](int lane) const {
    return part_[lane / part_width][lane % part_width];
  }

  /// Numbers that are `stride` apart.
  static Lanes load(const double* from, std::ptrdiff_t stride) {
    Lanes result;
    if (stride == 1) {
      for (int k = 0; k < parts; ++k)
        result.part_[k] = reinterpret_cast<const Unaligned*>(from)[k];
      return result;
    }
    for (int k = 0; k < parts; ++k, from += part_width * stride)
#ifdef __AVX2__
      result.part_[k] = Part{from[0], from[stride], from[2 * stride], from[3 * stride]};
#else
      result.part_[k] = Part{from[0], from[stride]};
#endif
    return result;
  }
  void store(double* to, std::ptrdiff_t stride) const {
    if (stride == 1) {
      for (int k = 0; k < parts; ++k)
        reinterpret_cast<Unaligned*>(to)[k] = part_[k];
      return;
    }
    for (int k = 0; k < parts; ++k)
      for (int lane = 0; lane < part_width; ++lane, to += stride)
        *to = part_[k][lane];
  }

private:
#ifdef __AVX2__
  using Unaligned = double __attribute__((vector_size(32), aligned(8), may_alias));
#else
  using Unaligned = double __attribute__((vector_size(16), aligned(8), may_alias));
#endif
  static MaskPart sign_bit() {
    return reinterpret_cast<MaskPart>(-0.0 - Part{});
  }
  Part part_[parts];  // NOLINT
};

/// A double with the same words.
class Single {
public:
  static constexpr int width = 1;
  struct Mask {
    bool value;
    void operator|=(const Mask& other) { value = value || other.value; }
    Mask operator&(const Mask& other) const { return {value && other.value}; }
    bool any() const { return value; }
    unsigned bits() const { return value ? 1 : 0; }
  };
  Single() = default;
  Single(double value) : value_(value) {}  // NOLINT(google-explicit-constructor)
  Single operator+(Single b) const { return value_ + b.value_; }
  Single operator-(Single b) const { return value_ - b.value_; }
  Single operator*(Single b) const { return value_ * b.value_; }
  Single operator/(Single b) const { return value_ / b.value_; }
  Mask operator<(Single b) const { return {value_ < b.value_}; }
  Mask operator<=(Single b) const { return {value_ <= b.value_}; }
  Mask operator==(Single b) const { return {value_ == b.value_}; }
  static Mask not_ordered(Single a, Single b) { return {!(a.value_ <= b.value_)}; }
  Single absolute() const { return __builtin_fabs(value_); }
  static Single larger(Single a, Single b) { return a.value_ < b.value_ ? b : a; }
  static Single smaller(Single a, Single b) { return b.value_ < a.value_ ? b : a; }
  static Single choose(Mask mask, Single a, Single b) { return mask.value ? a : b; }
  double operator[](int) const { return value_; }
  static Single load(const double* from, std::ptrdiff_t) { return *from; }
  void store(double* to, std::ptrdiff_t) const { *to = value_; }

private:
  double value_;
};

}  // namespace
}  // namespace sweepvi
// NOLINTEND(cert-dcl59-cpp,cppcoreguidelines-pro-type-member-init,modernize-loop-convert)
