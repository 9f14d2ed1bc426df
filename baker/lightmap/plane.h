#pragma once

#include <cassert>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

namespace kiln::lightmap {

/// One value per texel. Copies share the values, so that what a pass leaves as it was costs neither
/// memory nor time; who wants to change them asks for its own first.
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

  /// Makes the values its own, by a copy if another plane has them too; `renew` without what they
  /// were. One thread at a time, before any writes.
  std::vector<T>& own() {
    if (values_.use_count() > 1) values_ = std::make_shared<std::vector<T>>(*values_);
    return *values_;
  }
  void renew() {
    if (values_.use_count() > 1)
      values_ = std::make_shared<std::vector<T>>(values_->size());
    else
      values_->assign(values_->size(), T{});
  }
  /// To write a value that is its own.
  T& operator[](std::size_t texel) {
    assert(values_.use_count() == 1);
    return (*values_)[texel];
  }

 private:
  std::shared_ptr<std::vector<T>> values_;
};

}  // namespace kiln::lightmap
