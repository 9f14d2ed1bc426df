#include <algorithm>
#include <nlohmann/json.hpp>

#include "proto/json.h"
#include "proto/json_values.h"
#include "proto/nearest_name.h"
#include "proto/problem_list.h"

namespace kiln::proto {
namespace {

using nlohmann::json;

bool is_label_name(const std::string& name) {
  return !name.empty() && name.size() <= JobOptions::kMaxLabelName &&
         std::all_of(name.begin(), name.end(), [](char c) {
           return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') ||
                  std::string_view("._/-").find(c) != std::string_view::npos;
         });
}

bool is_label_value(const std::string& value) {
  return value.size() <= JobOptions::kMaxLabelValue &&
         std::none_of(value.begin(), value.end(), [](unsigned char c) { return c < 0x20; });
}

/// Reads the members that options and patches share, and collects what is wrong with them.
class OptionReader {
 public:
  explicit OptionReader(const json& doc) : doc_(doc) {
    if (!doc.is_object()) problems_.add("", "expected an object, found " + brief_value(doc));
  }

  std::optional<std::int32_t> priority() {
    constexpr std::int64_t kMax = JobOptions::kMaxPriority;
    const auto value = integer("priority", -kMax, kMax);
    if (!value) return std::nullopt;
    return static_cast<std::int32_t>(*value);
  }

  std::optional<std::uint64_t> ttl_seconds() {
    const auto value =
        integer("ttl_seconds", 0, static_cast<std::int64_t>(JobOptions::kMaxTtlSeconds));
    if (!value) return std::nullopt;
    return static_cast<std::uint64_t>(*value);
  }

  std::optional<bool> boolean(const char* key) {
    const json* value = find(key);
    if (value == nullptr) return std::nullopt;
    if (value->is_boolean()) return value->get<bool>();
    problems_.add("/" + std::string(key), "expected true or false, found " + brief_value(*value));
    return std::nullopt;
  }

  /// Reads the labels. `null_allowed` is set for a patch, where null removes a label.
  std::map<std::string, std::optional<std::string>> labels(bool null_allowed) {
    std::map<std::string, std::optional<std::string>> out;
    const json* all = find("labels");
    if (all == nullptr) return out;
    if (!all->is_object()) {
      problems_.add("/labels", "expected an object, found " + brief_value(*all));
      return out;
    }
    if (all->size() > JobOptions::kMaxLabels)
      problems_.add("/labels", "expected at most " + std::to_string(JobOptions::kMaxLabels) +
                                   " labels, found " + std::to_string(all->size()));
    for (const auto& [name, value] : all->items()) {
      if (!is_label_name(name)) {
        problems_.add("/labels", "the name \"" + brief(name) +
                                     "\" is not of 1 to 63 characters of A-Z a-z 0-9 . _ / -");
      } else if (value.is_null() && null_allowed) {
        out[name] = std::nullopt;
      } else if (value.is_string() && is_label_value(value.get_ref<const std::string&>())) {
        out[name] = value.get<std::string>();
      } else {
        problems_.add("/labels/" + pointer_token(name),
                      "expected a text of at most 255 bytes without control characters" +
                          std::string(null_allowed ? ", or null" : "") + ", found " +
                          brief_value(value));
      }
    }
    return out;
  }

  std::optional<Webhook> webhook() {
    const json* value = find("webhook");
    if (value == nullptr || value->is_null()) return std::nullopt;
    return read_webhook(*value, "/webhook", problems_);
  }

  Expected<void> finish() {
    if (doc_.is_object())
      for (const auto& [key, value] : doc_.items())
        if (std::find(known_.begin(), known_.end(), key) == known_.end())
          problems_.add("/" + pointer_token(brief(key)), "unknown member" + name_hint(key, known_));
    if (problems_.empty()) return {};
    return Unexpected(std::move(problems_).error("invalid_request"));
  }

 private:
  const json& doc_;
  ProblemList problems_{"request"};
  std::vector<std::string_view> known_;

  const json* find(const char* key) {
    known_.push_back(key);
    if (!doc_.is_object()) return nullptr;
    const auto at = doc_.find(key);
    return at == doc_.end() ? nullptr : &*at;
  }

  std::optional<std::int64_t> integer(const char* key, std::int64_t min, std::int64_t max) {
    const json* value = find(key);
    if (value == nullptr) return std::nullopt;
    const bool fits =
        value->is_number_integer() &&
        (!value->is_number_unsigned() || value->get<std::uint64_t>() <= std::uint64_t(max)) &&
        value->get<std::int64_t>() >= min && value->get<std::int64_t>() <= max;
    if (fits) return value->get<std::int64_t>();
    problems_.add("/" + std::string(key), "expected an integer from " + std::to_string(min) +
                                              " to " + std::to_string(max) + ", found " +
                                              brief_value(*value));
    return std::nullopt;
  }
};

}  // namespace

Expected<JobOptions> job_options_from_json(const json& doc) {
  OptionReader in(doc);
  JobOptions out;
  out.priority = in.priority().value_or(0);
  for (auto& [name, value] : in.labels(false)) out.labels[name] = *value;
  out.ttl_seconds = in.ttl_seconds();
  out.dedupe = in.boolean("dedupe").value_or(true);
  out.webhook = in.webhook();
  if (auto ok = in.finish(); !ok) return Unexpected(std::move(ok.error()));
  return out;
}

Expected<JobPatch> job_patch_from_json(const json& doc) {
  OptionReader in(doc);
  JobPatch out;
  out.priority = in.priority();
  out.labels = in.labels(true);
  out.ttl_seconds = in.ttl_seconds();
  if (auto ok = in.finish(); !ok) return Unexpected(std::move(ok.error()));
  return out;
}

json to_json(const JobOptions& o) {
  json out{{"priority", o.priority},
           {"labels", o.labels},
           {"ttl_seconds", o.ttl_seconds ? json(*o.ttl_seconds) : json(nullptr)},
           {"dedupe", o.dedupe}};
  // A job without a webhook has no such member, because idempotency keys of older versions depend
  // on this text.
  if (o.webhook) out["webhook"] = to_json(*o.webhook);
  return out;
}

Expected<Labels> labels_from_json(const json& doc) {
  const json wrapped{{"labels", doc}};
  OptionReader in(wrapped);
  Labels out;
  for (auto& [name, value] : in.labels(false)) out[name] = *value;
  if (auto ok = in.finish(); !ok) return Unexpected(std::move(ok.error()));
  return out;
}

}  // namespace kiln::proto
