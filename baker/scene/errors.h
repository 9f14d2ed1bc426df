#pragma once

#include <string>

#include "proto/expected.h"

namespace kiln::baker {

/// The scene is wrong at this place of the glTF.
inline proto::Unexpected invalid(const std::string& why, const std::string& pointer) {
  return proto::fail("invalid_scene", why, "scene", pointer);
}

inline proto::Unexpected canceled() {
  return proto::fail(proto::kCanceledCode, "canceled");
}

}  // namespace kiln::baker
