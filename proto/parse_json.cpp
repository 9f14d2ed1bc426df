#include <algorithm>
#include <nlohmann/json.hpp>
#include <set>
#include <vector>

#include "proto/json.h"
#include "proto/json_values.h"

namespace kiln::proto {
namespace {

using nlohmann::json;

constexpr std::size_t kMaxDepth = 64;
constexpr std::size_t kMaxPointer = 256;

/// Returns the byte at which nesting becomes too deep, or npos. Only brackets outside strings
/// count.
std::size_t too_deep_at(std::string_view text) {
  std::size_t depth = 0;
  bool in_string = false;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    if (in_string) {
      if (c == '\\') ++i;
      if (c == '"') in_string = false;
    } else if (c == '"') {
      in_string = true;
    } else if (c == '[' || c == '{') {
      if (++depth > kMaxDepth) return i;
    } else if ((c == ']' || c == '}') && depth > 0) {
      --depth;
    }
  }
  return std::string_view::npos;
}

/// Extracts the reason from the parser's message, where it stands between "column N: " and "; last
/// read". The rest repeats text of the document, which may be anything, so it is dropped.
std::string reason(std::string_view what) {
  const auto column = what.find(", column ");
  const auto colon = column == std::string_view::npos ? column : what.find(": ", column);
  if (colon == std::string_view::npos) return "number out of range";
  what.remove_prefix(colon + 2);
  return std::string(what.substr(0, what.find("; last read")));
}

/// Builds the value from parser events, since a parser's callback sees a repeated key only after
/// the first value is lost.
class Builder : public nlohmann::json_sax<json> {
 public:
  json root;
  std::string duplicate;  ///< pointer of a repeated key
  std::size_t error_byte = 0;
  std::string error_text;

  bool null() override { return put(nullptr) != nullptr; }
  bool boolean(bool v) override { return put(v) != nullptr; }
  bool number_integer(std::int64_t v) override { return put(v) != nullptr; }
  bool number_unsigned(std::uint64_t v) override { return put(v) != nullptr; }
  bool number_float(double v, const std::string&) override { return put(v) != nullptr; }
  bool string(std::string& v) override { return put(std::move(v)) != nullptr; }
  bool binary(json::binary_t&) override { return false; }  // Binary values don't occur in text.
  bool start_object(std::size_t) override { return open(json::object()); }
  bool start_array(std::size_t) override { return open(json::array()); }
  bool end_object() override { return close(); }
  bool end_array() override { return close(); }

  bool key(std::string& k) override {
    key_ = std::move(k);
    if (!open_.back()->contains(key_)) return true;
    duplicate = pointer_to(key_);
    return false;
  }

  bool parse_error(std::size_t byte, const std::string&, const json::exception& e) override {
    error_byte = byte > 0 ? byte - 1 : 0;
    error_text = reason(e.what());
    return false;
  }

 private:
  // The addresses stay valid, since an array grows only when none of its items is open.
  std::vector<json*> open_;
  std::vector<std::string> path_;
  std::string key_;

  json* put(json v) {
    if (open_.empty()) return &(root = std::move(v));
    json& parent = *open_.back();
    if (parent.is_object()) return &(parent[key_] = std::move(v));
    parent.push_back(std::move(v));
    return &parent.back();
  }

  bool open(json v) {
    if (!open_.empty())
      path_.push_back(open_.back()->is_object() ? key_ : std::to_string(open_.back()->size()));
    open_.push_back(put(std::move(v)));
    return true;
  }

  bool close() {
    open_.pop_back();
    if (!path_.empty()) path_.pop_back();
    return true;
  }

  std::string pointer_to(const std::string& last) const {
    std::string pointer;
    for (const auto& token : path_) pointer += "/" + pointer_token(token);
    return pointer + "/" + pointer_token(last);
  }
};

}  // namespace

std::string line_and_column(std::string_view text, std::size_t byte) {
  const auto before = text.substr(0, std::min(byte, text.size()));
  const auto line = 1 + std::count(before.begin(), before.end(), '\n');
  const auto start = before.rfind('\n');
  const auto column = start == std::string_view::npos ? before.size() + 1 : before.size() - start;
  return "line " + std::to_string(line) + ", column " + std::to_string(column);
}

Expected<json> parse_json(std::string_view text, std::string_view source) {
  const auto invalid = [&](const std::string& pointer, const std::string& what) {
    return fail("invalid_json", std::string(source) + ": " + what, std::string(source), pointer);
  };
  if (const auto at = too_deep_at(text); at != std::string_view::npos)
    return invalid("", "nested deeper than " + std::to_string(kMaxDepth) + " levels at " +
                           line_and_column(text, at));
  Builder builder;
  if (json::sax_parse(text, &builder)) return std::move(builder.root);
  if (!builder.duplicate.empty()) {
    const bool long_key = builder.duplicate.size() > kMaxPointer;
    return invalid(long_key ? "" : builder.duplicate,
                   "the key at " + brief(builder.duplicate, kMaxPointer) + " occurs twice");
  }
  return invalid("", "not valid JSON at " + line_and_column(text, builder.error_byte) + ": " +
                         builder.error_text);
}

std::string to_text(const json& value, int indent) {
  return value.dump(indent, ' ', false, json::error_handler_t::replace);
}

}  // namespace kiln::proto
