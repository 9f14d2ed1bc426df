#pragma once

#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <stop_token>
#include <string>
#include <string_view>

#include "proto/expected.h"

namespace kiln::gltf {

/// "/nodes/3" from ("/nodes", 3); keys are escaped as RFC 6901 asks.
std::string pointer_to(const std::string& parent, std::size_t index);
std::string pointer_to(const std::string& parent, std::string_view key);

/// Text of a document for a message: at most `max` bytes, cut between UTF-8 sequences, no control
/// characters. The text must be valid UTF-8.
std::string shortened(std::string_view text, std::size_t max = 100);

/// Parses the document and keeps what a bake reads of it (gltf_schema.h): extras and the like are
/// passed over. Nesting and number of values (16 million) are limited, so that no text can
/// cost more memory than about a hundred times that.
/// Errors: `invalid_scene` with line and column, `limit_exceeded`, `canceled`.
proto::Expected<nlohmann::json> parse_gltf_json(std::string_view text, std::uint32_t max_depth,
                                                const std::stop_token&);

/// Checks every property of a document that parse_gltf_json returned: presence, type, range, and
/// that each index has its target. Whole numbers become unsigned integers where integers are due
/// ("1.0" is legal). Errors: `invalid_scene` with the first wrong place, `canceled`.
proto::Expected<void> check_gltf(nlohmann::json& document, const std::stop_token&);

}  // namespace kiln::gltf
