#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>

#include "proto/expected.h"

namespace kiln::baker {

/// "/nodes/3" from ("/nodes", 3); keys are escaped as RFC 6901 asks.
std::string pointer_to(const std::string& parent, std::size_t index);
std::string pointer_to(const std::string& parent, std::string_view key);

/// Text of a document for a message: at most `max` bytes, cut between UTF-8 sequences, no control
/// characters. The text must be valid UTF-8.
std::string shortened(std::string_view text, std::size_t max = 100);

/// Parses the document after its nesting (128) and its number of values (16 million) were counted,
/// so that no text can cost more memory than about a hundred times that.
/// Errors: `invalid_scene` with line and column, `limit_exceeded`.
proto::Expected<nlohmann::json> parse_gltf_json(std::string_view text);

/// Checks every property of the document that a bake reads: presence, type, range, and that each
/// index has its target. Whole numbers become unsigned integers where integers are due ("1.0" is
/// legal). Everything else is removed, so that no later reader meets what was not checked.
/// Errors: `invalid_scene` with the first wrong place.
proto::Expected<void> check_and_prune(nlohmann::json& document);

}  // namespace kiln::baker
