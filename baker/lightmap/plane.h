#pragma once

#include <cassert>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <utility>
#include <vector>

namespace kiln::lightmap {

/// One value per texel. Copies share the values, so that a plane which a pass leaves alone costs
/// neither memory nor time. A writer calls detach() or clear() first.
template <class T>
class Plane {
 public:
  Plane() : Plane(0) {}
  explicit Plane(std::uint32_t texels, T value = {})
      : values_(std::make_shared<std::vector<T>>(texels, value)) {}
  // NOLINTNEXTLINE(google-explicit-constructor): values in a row are a plane
  Plane(std::vector<T> values) : values_(std::make_shared<std::vector<T>>(std::move(values))) {}

  std::uint32_t size() const { return static_cast<std::uint32_t>(values_->size()); }
  const T& operator[](std::size_t texel) const { return (*values_)[texel]; }
  auto begin() const { return values_->cbegin(); }
  auto end() const { return values_->cend(); }
  const std::vector<T>& values() const { return *values_; }

  /// Gives this plane values of its own, by a copy if another plane shares them. One thread at a
  /// time, before any writes.
  std::vector<T>& detach() {
    if (values_.use_count() > 1) values_ = std::make_shared<std::vector<T>>(*values_);
    return *values_;
  }
  /// Gives this plane values of its own that are all zero.
  void clear() {
    if (values_.use_count() > 1)
      values_ = std::make_shared<std::vector<T>>(values_->size());
    else
      values_->assign(values_->size(), T{});
  }
  /// Writes a value of a plane that shares its values with no other.
  T& operator[](std::size_t texel) {
    assert(values_.use_count() == 1);
    return (*values_)[texel];
  }

  /// Returns the first value, for writing. Requires detach() or clear() before.
  T* data() {
    assert(values_.use_count() == 1);
    return values_->data();
  }
  /// Returns the bytes of the texels [first, last).
  std::size_t texel_bytes() const { return size() > 0 ? sizeof(T) : 0; }
  std::span<const std::byte> bytes(std::uint32_t first, std::uint32_t last) const {
    return std::as_bytes(std::span(*values_).subspan(first, last - first));
  }
  std::span<std::byte> bytes(std::uint32_t first, std::uint32_t last) {
    return std::as_writable_bytes(std::span(data() + first, last - first));
  }

 private:
  std::shared_ptr<std::vector<T>> values_;
};

}  // namespace kiln::lightmap
