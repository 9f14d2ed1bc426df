#include "baker/gltf/json.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <span>
#include <utility>
#include <vector>

#include "baker/exec/stop.h"
#include "baker/gltf/errors.h"
#include "baker/gltf/schema.h"

namespace kiln::gltf {
namespace {

using nlohmann::json;

constexpr std::size_t kMaxValues = 16'000'000, kPollInterval = 1 << 16;

std::string line_and_column(std::string_view text, std::size_t byte) {
  const auto before = text.substr(0, std::min(byte, text.size()));
  const auto line = 1 + std::count(before.begin(), before.end(), '\n');
  const auto newline = before.rfind('\n');
  const auto column =
      newline == std::string_view::npos ? before.size() : before.size() - newline - 1;
  return "line " + std::to_string(line) + ", column " + std::to_string(column);
}

/// Builds the document from the parser's events, without what the schema doesn't name. Where a
/// value has another type than the schema's it is kept whole, for the check to find.
class PruningReader {
 public:
  PruningReader(std::string_view text, std::size_t max_depth, const std::stop_token& stop)
      : text_(text), max_depth_(max_depth), stop_(stop) {}

  json& document() { return document_; }
  const proto::Error& error() const { return error_; }

  // What json::sax_parse calls; false stops it.
  bool null() { return add(nullptr); }
  bool boolean(bool value) { return add(value); }
  bool number_integer(json::number_integer_t value) { return add(value); }
  bool number_unsigned(json::number_unsigned_t value) { return add(value); }
  bool number_float(json::number_float_t value, const std::string&) { return add(value); }
  bool string(std::string& value) { return add(std::move(value)); }
  bool binary(json::binary_t&) { return false; }  // JSON text has none
  bool start_object(std::size_t) { return open(json::object(), Kind::kObject); }
  bool start_array(std::size_t) { return open(json::array(), Kind::kObjects); }
  bool end_object() { return close(); }
  bool end_array() { return close(); }

  bool key(std::string& name) {
    if (dropped_ > 0) return true;
    Frame& in = frames_.back();
    in.member = nullptr;
    in.field = nullptr;
    if (in.keep == Keep::kListed) {
      const auto field = std::find_if(in.fields.begin(), in.fields.end(),
                                      [&](const Field& f) { return f.name == name; });
      if (field == in.fields.end()) return true;
      in.field = &*field;
    }
    in.member = &(*in.value)[std::move(name)];
    return true;
  }

  bool parse_error(std::size_t byte, const std::string&, const json::exception& e) {
    constexpr int kNumberOverflow = 406;
    error_ = e.id == kNumberOverflow
                 ? proto::fail("invalid_scene", "the JSON holds a number that is not finite",
                               "scene", "")
                       .value()
                 : proto::fail("invalid_scene", "not valid JSON at " + line_and_column(text_, byte),
                               "scene", "")
                       .value();
    return false;
  }

 private:
  enum class Keep {
    kAll,
    kListed,    ///< an object: the members in `fields`
    kElements,  ///< an array of such objects
  };
  struct Frame {
    json* value = nullptr;
    Keep keep = Keep::kAll;
    std::span<const Field> fields{};
    json* member = nullptr;        ///< of an object: where its next value goes; nullptr: nowhere
    const Field* field = nullptr;  ///< the schema's word on that member
  };

  bool limit(const proto::Unexpected& error) {
    error_ = error.value();
    return false;
  }

  bool count() {
    if (++values_ > kMaxValues)
      return limit(over_limit("the JSON holds too many values", kMaxValues, "json_values", ""));
    if (values_ % kPollInterval == 0 && stop_.stop_requested()) {
      error_ = exec::canceled().value();
      return false;
    }
    return true;
  }

  /// Where the next value goes; nullptr when it is not kept.
  json* place() {
    if (frames_.empty()) return &document_;
    Frame& in = frames_.back();
    return in.value->is_array() ? &in.value->emplace_back() : in.member;
  }

  bool add(json value) {
    if (!count()) return false;
    if (dropped_ > 0) return true;
    if (json* const to = place()) *to = std::move(value);
    return true;
  }

  /// @param kind that a listed member has when its value is pruned too
  bool open(json value, Kind kind) {
    if (!count()) return false;
    if (++depth_ > max_depth_)
      return limit(over_limit("the JSON is nested too deep", max_depth_, "scene_json_depth", ""));
    json* const to = dropped_ > 0 ? nullptr : place();
    if (!to) {
      ++dropped_;
      return true;
    }
    *to = std::move(value);
    frames_.push_back(frame_of(*to, kind));
    return true;
  }

  Frame frame_of(json& value, Kind kind) const {
    const bool is_object = kind == Kind::kObject;
    const Keep pruned = is_object ? Keep::kListed : Keep::kElements;
    if (frames_.empty()) return is_object ? Frame{&value, pruned, gltf_fields()} : Frame{&value};
    const Frame& in = frames_.back();
    if (in.keep == Keep::kElements && is_object) return {&value, pruned, in.fields};
    if (in.field && in.field->kind == kind) return {&value, pruned, in.field->fields};
    return {&value};
  }

  bool close() {
    --depth_;
    if (dropped_ > 0) {
      --dropped_;
    } else {
      frames_.pop_back();
    }
    return true;
  }

  std::string_view text_;
  std::size_t max_depth_;
  const std::stop_token& stop_;
  json document_;
  proto::Error error_;
  std::vector<Frame> frames_;  ///< open values that are kept
  std::size_t dropped_ = 0;    ///< open values that are not, all inside the last frame
  std::size_t depth_ = 0, values_ = 0;
};

}  // namespace

std::string pointer_to(const std::string& parent, std::size_t index) {
  return parent + "/" + std::to_string(index);
}

std::string pointer_to(const std::string& parent, std::string_view key) {
  std::string out = parent + "/";
  for (const char c : key) {
    if (c == '~') {
      out += "~0";
    } else if (c == '/') {
      out += "~1";
    } else {
      out += c;
    }
  }
  return out;
}

std::string shortened(std::string_view text, std::size_t max) {
  std::string out(text.substr(0, max));
  if (text.size() > max) {
    const auto is_continuation = [](char c) {
      return (static_cast<unsigned char>(c) & 0xc0) == 0x80;
    };
    std::size_t end = max;
    while (end > 0 && is_continuation(text[end])) --end;
    out.resize(end);
    out += "...";
  }
  for (char& c : out) {
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) c = ' ';
  }
  return out;
}

proto::Expected<json> parse_gltf_json(std::string_view text, std::uint32_t max_depth,
                                      const std::stop_token& stop) {
  PruningReader reader(text, max_depth, stop);
  const bool parsed = json::sax_parse(text, &reader);
  if (!parsed) return proto::Unexpected(reader.error());
  if (reader.document().is_object()) return std::move(reader.document());
  return proto::fail("invalid_scene", "the glTF document is not a JSON object", "scene", "");
}

}  // namespace kiln::gltf
