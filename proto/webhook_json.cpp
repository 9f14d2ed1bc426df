#include <algorithm>
#include <nlohmann/json.hpp>

#include "proto/json_values.h"
#include "proto/nearest_name.h"
#include "proto/problem_list.h"
#include "proto/webhook.h"

namespace kiln::proto {
namespace {

using nlohmann::json;

bool is_url_text(const std::string& url) {
  return !url.empty() && url.size() <= Webhook::kMaxUrl &&
         std::all_of(url.begin(), url.end(), [](char c) { return c > ' ' && c <= '~'; });
}

bool is_secret_name(const std::string& name) {
  return !name.empty() && name.size() <= Webhook::kMaxSecretRef &&
         std::all_of(name.begin(), name.end(), [](char c) {
           return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') ||
                  std::string_view("._-").find(c) != std::string_view::npos;
         });
}

void read_events(const json& value, const std::string& pointer, std::vector<std::string>& out,
                 ProblemList& problems) {
  if (!value.is_array() || value.empty())
    return problems.add(pointer, "expected a list of events, found " + brief_value(value));
  out.clear();
  const std::vector<std::string_view> known(kWebhookEvents.begin(), kWebhookEvents.end());
  for (std::size_t i = 0; i < value.size(); ++i) {
    const std::string place = pointer + "/" + std::to_string(i);
    if (!value[i].is_string()) {
      problems.add(place, "expected a text, found " + brief_value(value[i]));
      continue;
    }
    const auto name = value[i].get<std::string>();
    if (std::find(known.begin(), known.end(), name) == known.end())
      problems.add(place, "unknown event " + brief_value(value[i]) + name_hint(name, known));
    else if (std::find(out.begin(), out.end(), name) != out.end())
      problems.add(place, brief_value(value[i]) + " occurs twice");
    else
      out.push_back(name);
  }
}

}  // namespace

bool Webhook::wants(std::string_view event) const {
  return std::find(events.begin(), events.end(), event) != events.end();
}

json to_json(const Webhook& hook) {
  json out{{"url", hook.url}, {"events", hook.events}, {"secret_ref", nullptr}};
  if (!hook.secret_ref.empty()) out["secret_ref"] = hook.secret_ref;
  return out;
}

std::optional<Webhook> read_webhook(const json& doc, const std::string& pointer,
                                    ProblemList& problems) {
  if (!doc.is_object()) {
    problems.add(pointer, "expected an object, found " + brief_value(doc));
    return std::nullopt;
  }
  Webhook out;
  const std::vector<std::string_view> known{"url", "events", "secret_ref"};
  for (const auto& [key, value] : doc.items()) {
    const std::string place = pointer + "/" + pointer_token(key);
    if (key == "url" && value.is_string() && is_url_text(value.get_ref<const std::string&>())) {
      value.get_to(out.url);
    } else if (key == "url") {
      problems.add(place, "expected a URL of at most 2,048 visible ASCII characters, found " +
                              brief_value(value));
    } else if (key == "events") {
      read_events(value, place, out.events, problems);
    } else if (key == "secret_ref" && value.is_string() &&
               is_secret_name(value.get_ref<const std::string&>())) {
      value.get_to(out.secret_ref);
    } else if (key == "secret_ref" && !value.is_null()) {
      problems.add(place, "expected a name of 1 to 63 characters of A-Z a-z 0-9 . _ -, found " +
                              brief_value(value));
    } else if (key != "secret_ref") {
      problems.add(place, "unknown member" + name_hint(key, known));
    }
  }
  if (!doc.contains("url")) problems.add(pointer + "/url", "missing");
  return out;
}

Expected<Webhook> webhook_from_json(const json& doc) {
  ProblemList problems("request");
  auto hook = read_webhook(doc, "", problems);
  if (problems.empty()) return std::move(*hook);
  return Unexpected(std::move(problems).error("invalid_request"));
}

}  // namespace kiln::proto
