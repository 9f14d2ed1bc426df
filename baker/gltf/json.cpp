#include "baker/gltf/json.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <span>
#include <unordered_map>
#include <utility>
#include <vector>

#include "baker/exec/stop.h"
#include "baker/gltf/findings.h"
#include "baker/gltf/schema.h"
#include "proto/json.h"

namespace kiln::gltf {
namespace {

constexpr std::size_t kMaxValues = 16'000'000, kPollInterval = 1 << 16;

/// Members of the root that the library is not given: it would open or decode buffers and images,
/// no bake reads the last three, and the others go past its text, see model.h.
constexpr std::string_view kNotForTheLibrary[] = {"buffers",   "images", "nodes",      "meshes",
                                                  "accessors", "skins",  "animations", "cameras"};

/// Writes JSON text value by value.
class TextWriter {
 public:
  explicit TextWriter(std::string& out) : out_(out) {}

  void open(char bracket) {
    separate();
    out_ += bracket;
  }
  void close(char bracket) { out_ += bracket; }
  void key(std::string_view name) {
    text(name);
    out_ += ':';
  }
  void literal(std::string_view value) {
    separate();
    out_ += value;
  }
  void text(std::string_view value) {
    separate();
    out_ += '"';
    for (const char c : value) {
      constexpr const char* kHex = "0123456789abcdef";
      const auto code = static_cast<unsigned char>(c);
      if (code < 0x20) {
        out_ += "\\u00";
        out_ += kHex[code >> 4];
        out_ += kHex[code & 15];
        continue;
      }
      if (c == '"' || c == '\\') out_ += '\\';
      out_ += c;
    }
    out_ += '"';
  }

 private:
  void separate() {
    const char last = out_.empty() ? '{' : out_.back();
    if (last != '{' && last != '[' && last != ':') out_ += ',';
  }
  std::string& out_;
};

/// Finds the members of an object while it is read, in constant time: a hostile object may have
/// millions of them.
class MemberIndex {
 public:
  /// The member's value, made where there is none yet. Valid until the next call.
  Json& at(Json::object_t& members, std::string& name) {
    constexpr std::size_t kFew = 24;
    if (members.size() < kFew) {
      for (auto& [key, value] : members)
        if (key == name) return value;
      return members.emplace_back(std::move(name), nullptr).second;
    }
    if (!places_) places_ = std::make_unique<std::unordered_map<std::string, std::size_t>>();
    for (std::size_t i = places_->size(); i < members.size(); ++i)
      places_->emplace(members.data()[i].first, i);
    const auto found = places_->find(name);
    if (found != places_->end()) return members.data()[found->second].second;
    return members.emplace_back(std::move(name), nullptr).second;
  }

 private:
  std::unique_ptr<std::unordered_map<std::string, std::size_t>> places_;
};

bool wants_integer(Kind kind) {
  switch (kind) {
    case Kind::kInteger:
    case Kind::kIndex:
    case Kind::kIndices:
    case Kind::kIndexMap:
    case Kind::kIndexMaps:
    case Kind::kIntegerMap:
      return true;
    default:
      return false;
  }
}

/// Builds the document and the library's text from the parser's events. Where a value has another
/// type than the schema's it is kept whole, for the check to find.
class Reader {
 public:
  Reader(std::string_view text, std::size_t max_depth, Keep keep, const std::stop_token& stop)
      : text_(text),
        max_depth_(max_depth),
        prunes_(keep == Keep::kWhatABakeReads),
        stop_(stop),
        writer_(out_.library_text) {
    out_.document = std::make_unique<Json>();
  }

  ParsedText& parsed() { return out_; }
  const proto::Error& error() const { return error_; }

  // json::sax_parse calls these; false stops it.
  bool null() { return add(nullptr, "null"); }
  bool boolean(bool value) { return add(value, value ? "true" : "false"); }
  bool number_integer(Json::number_integer_t value) { return add(value, std::to_string(value)); }
  bool number_unsigned(Json::number_unsigned_t value) { return add(value, std::to_string(value)); }
  bool number_float(Json::number_float_t value, const std::string& written) {
    const bool whole = std::abs(value) <= kMaxSize && std::trunc(value) == value;
    const bool rewritten = whole && !frames_.empty() && wants_integer(frames_.back().kind());
    return add(value, rewritten ? std::to_string(std::int64_t(value)) : written);
  }
  bool string(std::string& value) {
    if (!count()) return false;
    Json* const to = dropped_ > 0 ? nullptr : place();
    if (!to) return true;
    if (is_for_library()) writer_.text(value);
    *to = std::move(value);
    return true;
  }
  bool binary(Json::binary_t&) { return false; }  // JSON text has none
  bool start_object(std::size_t) { return open(Json::object(), Kind::kObject); }
  bool start_array(std::size_t) { return open(Json::array(), Kind::kObjects); }
  bool end_object() { return close('}'); }
  bool end_array() { return close(']'); }

  bool key(std::string& name) {
    if (dropped_ > 0) return true;
    Frame& in = frames_.back();
    in.member = nullptr;
    in.field = nullptr;
    if (in.listed == Listed::kMembers) {
      const auto field = std::find_if(in.fields.begin(), in.fields.end(),
                                      [&](const Field& f) { return f.name == name; });
      if (field != in.fields.end()) in.field = &*field;
      if (!in.field && prunes_) return true;
    }
    const bool is_known = in.listed == Listed::kNothing || in.field;
    const bool is_hidden = frames_.size() == 1 && std::ranges::find(kNotForTheLibrary, name) !=
                                                      std::end(kNotForTheLibrary);
    in.member_for_library = in.for_library && is_known && !is_hidden;
    if (in.member_for_library) writer_.key(name);
    in.member = &in.index.at(in.value->get_ref<Json::object_t&>(), name);
    return true;
  }

  bool parse_error(std::size_t byte, const std::string&, const Json::exception& e) {
    constexpr int kNumberOverflow = 406;
    const std::string why =
        e.id == kNumberOverflow
            ? "the JSON holds a number that is not finite"
            : "not valid JSON at " + proto::line_and_column(text_, byte > 0 ? byte - 1 : 0);
    error_ = invalid(why, "").value();
    return false;
  }

 private:
  /// The part of a value that the schema lists.
  enum class Listed {
    kNothing,   ///< it is kept whole
    kMembers,   ///< those members of an object that `fields` names
    kElements,  ///< an array of such objects
  };
  struct Frame {
    Json* value = nullptr;
    Listed listed = Listed::kNothing;
    std::span<const Field> fields{};
    const Field* of = nullptr;  ///< the schema's word on this value
    bool for_library = false;
    MemberIndex index{};
    Json* member = nullptr;           ///< place of an object's next value; nullptr: dropped
    const Field* field = nullptr;     ///< the schema's word on that member
    bool member_for_library = false;  ///< the library's text has it

    Kind kind() const {
      const Field* const known = field ? field : of;
      return known ? known->kind : Kind::kObject;
    }
  };

  bool limit(const proto::Unexpected& error) {
    error_ = error.value();
    return false;
  }

  bool count() {
    if (++values_ > kMaxValues)
      return limit(over_limit("the JSON holds too many values", kMaxValues, "json_values", ""));
    if (values_ % kPollInterval == 0 && stop_.stop_requested()) return limit(exec::canceled());
    return true;
  }

  /// Returns the next value's place; nullptr when it is not kept.
  Json* place() {
    if (frames_.empty()) return out_.document.get();
    Frame& in = frames_.back();
    return in.value->is_array() ? &in.value->emplace_back() : in.member;
  }

  /// Says whether the library's text has the value that comes next.
  bool is_for_library() const {
    if (frames_.empty()) return true;
    const Frame& in = frames_.back();
    return in.value->is_array() ? in.for_library : in.member_for_library;
  }

  bool add(Json value, std::string_view written) {
    if (!count()) return false;
    Json* const to = dropped_ > 0 ? nullptr : place();
    if (!to) return true;
    if (is_for_library()) writer_.literal(written);
    *to = std::move(value);
    return true;
  }

  /// @param kind that a listed member has when its own members are listed, too
  bool open(Json value, Kind kind) {
    if (!count()) return false;
    if (++depth_ > max_depth_)
      return limit(over_limit("the JSON is nested too deep", max_depth_, "scene_json_depth", ""));
    Json* const to = dropped_ > 0 ? nullptr : place();
    if (!to) {
      ++dropped_;
      return true;
    }
    *to = std::move(value);
    Frame frame = frame_of(*to, kind);
    frame.for_library = is_for_library();
    if (frame.for_library) writer_.open(kind == Kind::kObject ? '{' : '[');
    frames_.push_back(std::move(frame));
    return true;
  }

  Frame frame_of(Json& value, Kind kind) const {
    const bool is_object = kind == Kind::kObject;
    const Listed listed = is_object ? Listed::kMembers : Listed::kElements;
    if (frames_.empty()) return is_object ? Frame{&value, listed, gltf_fields()} : Frame{&value};
    const Frame& in = frames_.back();
    if (in.listed == Listed::kElements && is_object) return {&value, listed, in.fields};
    const Field* const of = in.value->is_array() ? in.of : in.field ? in.field : in.of;
    if (in.field && in.field->kind == kind) return {&value, listed, in.field->fields, of};
    return {&value, Listed::kNothing, {}, of};
  }

  bool close(char bracket) {
    --depth_;
    if (dropped_ > 0) {
      --dropped_;
      return true;
    }
    if (frames_.back().for_library) writer_.close(bracket);
    frames_.pop_back();
    return true;
  }

  std::string_view text_;
  std::size_t max_depth_;
  bool prunes_;
  const std::stop_token& stop_;
  ParsedText out_;
  TextWriter writer_;
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

std::optional<std::uint64_t> as_count(const Json& value) {
  if (value.is_number_unsigned()) return value.get<std::uint64_t>();
  if (!value.is_number()) return std::nullopt;
  const double number = value.get<double>();
  if (!(number >= 0) || number > kMaxSize || number != std::trunc(number)) return std::nullopt;
  return static_cast<std::uint64_t>(number);
}

std::optional<std::uint64_t> count_at(const Json& object, const char* key, std::uint64_t missing) {
  if (!object.is_object()) return std::nullopt;
  const auto found = object.find(key);
  return found == object.end() ? std::optional(missing) : as_count(*found);
}

const Json& collection(const Json& document, const char* name) {
  static const Json none = Json::array();
  const auto found = document.find(name);
  return found == document.end() ? none : *found;
}

ParsedText::ParsedText() = default;
ParsedText::ParsedText(ParsedText&&) noexcept = default;
ParsedText& ParsedText::operator=(ParsedText&&) noexcept = default;
ParsedText::~ParsedText() = default;

proto::Expected<ParsedText> parse_gltf_json(std::string_view text, std::uint32_t max_depth,
                                            Keep keep, const std::stop_token& stop) {
  Reader reader(text, max_depth, keep, stop);
  if (!Json::sax_parse(text, &reader)) return proto::Unexpected(reader.error());
  if (reader.parsed().document->is_object()) return std::move(reader.parsed());
  return invalid("the glTF document is not a JSON object", "");
}

}  // namespace kiln::gltf
