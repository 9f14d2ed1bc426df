#pragma once

#include <string>

#include "proto/expected.h"

namespace kiln::view {

/// Returns the error that a member of a view's request is wrong. `why` is a sentence about it.
inline proto::Unexpected wrong(const char* code, const std::string& member,
                               const std::string& why) {
  return proto::fail(code, "The view's `" + member + "`: " + why, "request", "/query/" + member);
}

}  // namespace kiln::view
