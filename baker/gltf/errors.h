#pragma once

#include <cstdint>
#include <string>

#include "proto/expected.h"

namespace kiln::gltf {

/// The scene is wrong at this place of the glTF.
inline proto::Unexpected invalid(const std::string& why, const std::string& pointer) {
  return proto::fail("invalid_scene", why, "scene", pointer);
}

/// The scene asks for more than one of the ImportLimits allows: `name` is the limit's, as
/// GET /v1/capabilities has it.
inline proto::Unexpected over_limit(const std::string& what, std::uint64_t limit, const char* name,
                                    const std::string& pointer) {
  return proto::fail(
      "limit_exceeded",
      what + ": the limit `" + name + "` of this service is " + std::to_string(limit), "scene",
      pointer);
}

}  // namespace kiln::gltf
