#pragma once

#include <stop_token>
#include <vector>

#include "baker/atlas/texture_group.h"
#include "baker/output/post.h"
#include "proto/expected.h"

namespace kiln::output {

/// Returns for each texel of a page (the first front_count) whether what lights it is hidden by a
/// lamp: it is a lamp itself, since it sends more light of its own than it could reflect, or a lamp
/// lies against it, less than a texel away in front, so that nobody sees between them. What is
/// behind a lamp is lit by it like nothing that is seen. `irradiance` in lx, `emission` in cd/m2.
/// Errors: `canceled`.
proto::Expected<std::vector<bool>> hidden_by_lamps(const atlas::TextureGroup&,
                                                   const TexelValue& irradiance,
                                                   const TexelValue& emission,
                                                   const std::stop_token&);

}  // namespace kiln::output
