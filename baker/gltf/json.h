#pragma once

#include <cstdint>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <stop_token>
#include <string>
#include <string_view>

#include "proto/expected.h"

namespace kiln::gltf {

/// The JSON of a glTF document everywhere in the baker: members keep the order of the file, which
/// lit.glb repeats.
using Json = nlohmann::ordered_json;

/// Returns "/nodes/3" for ("/nodes", 3); keys are escaped as RFC 6901 asks.
std::string pointer_to(const std::string& parent, std::size_t index);
std::string pointer_to(const std::string& parent, std::string_view key);

/// Returns text of a document for a message: at most `max` bytes, cut between UTF-8 sequences, no
/// control characters. The text must be valid UTF-8.
std::string shortened(std::string_view text, std::size_t max = 100);

/// A whole number >= 0, also when it is written as 1.0; nothing for any other value.
std::optional<std::uint64_t> as_count(const Json&);
/// Returns object[key] as such a number, or `missing` when the key is absent; nothing when the
/// value is no such number, or `object` is no object.
std::optional<std::uint64_t> count_at(const Json& object, const char* key, std::uint64_t missing);

/// Returns a member of the document; an empty array when it is absent.
const Json& collection(const Json& document, const char* name);

/// The extent to which the reader keeps a document.
enum class Keep {
  kWhatABakeReads,  ///< the members that schema.h lists: extras and the like are passed over
  kEverything,
};

/// A document that was parsed, and the text that the library reads of it.
struct ParsedText {
  ParsedText();
  ParsedText(ParsedText&&) noexcept;
  ParsedText& operator=(ParsedText&&) noexcept;
  ~ParsedText();

  std::unique_ptr<Json> document;
  /// The document's text as tinygltf is given it, see read_model() (model.h): the original's values
  /// without the members that no bake reads, and without the collections that the library must not
  /// see. Whole numbers that are written as "1.0" are written as "1" where glTF wants integers,
  /// since the library takes no others.
  std::string library_text;
};

/// Parses the JSON of a document. Nesting and the number of values (16 million) are limited, so
/// that no text costs more memory than about a hundred times its length. A key that comes twice has
/// its last value. Errors: `invalid_scene` with line and column, `limit_exceeded`, `canceled`.
proto::Expected<ParsedText> parse_gltf_json(std::string_view text, std::uint32_t max_depth, Keep,
                                            const std::stop_token&);

/// Checks every property of a document that schema.h lists: presence, type, range, and that each
/// index has its target. Errors: `invalid_scene` with the first wrong place, `canceled`.
proto::Expected<void> check_gltf(const Json& document, const std::stop_token&);

}  // namespace kiln::gltf
