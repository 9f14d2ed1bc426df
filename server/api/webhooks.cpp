#include "server/api/webhooks.h"

#include <chrono>
#include <nlohmann/json.hpp>

#include "proto/json.h"
#include "server/api/request.h"
#include "server/http/problem.h"

namespace kiln::api {
namespace {

http::Response send_test(const WebhookTests& part, http::Request& request,
                         const nlohmann::json& body) {
  auto hook = proto::webhook_from_json(body);
  if (!hook) return problem(hook.error(), request);
  const std::string& tenant = request.principal.tenant;
  if (auto ok = part.webhooks.check(*hook, tenant); !ok) return problem(ok.error(), request);
  if (!part.slots.try_acquire())
    return problem({"overloaded", "Too many webhooks are being tested.", {}}, request);
  const Slot slot(part.slots);
  const auto began = std::chrono::steady_clock::now();
  const webhooks::Webhooks::Tested tested = part.webhooks.test(*hook, tenant);
  request.asleep += std::chrono::steady_clock::now() - began;
  nlohmann::json document{{"id", tested.id},
                          {"delivered", tested.answer.delivered()},
                          {"status", nullptr},
                          {"error", nullptr}};
  if (tested.answer.status != 0) document["status"] = tested.answer.status;
  if (!tested.answer.error.empty()) document["error"] = tested.answer.error;
  return http::json_response(202, document);
}

}  // namespace

http::Response test_webhook(const WebhookTests& part, http::Request& request) {
  return receive_json_object(request, part.intake, [&part](http::Request& again, const auto& body) {
    return send_test(part, again, body.value_or(nlohmann::json::object()));
  });
}

}  // namespace kiln::api
