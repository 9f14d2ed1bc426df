#include <nlohmann/json.hpp>

#include "server/api/api.h"
#include "server/http/problem.h"

namespace kiln::api {

// Sends one message and tells what came of it. Holds a thread meanwhile.
http::Response Api::test_webhook(http::Request& request) {
  return receive_json_object(request, [this](http::Request& again, const auto& body) {
    return send_test_webhook(again, body.value_or(nlohmann::json::object()));
  });
}

http::Response Api::send_test_webhook(http::Request& request, const nlohmann::json& body) {
  auto hook = proto::webhook_from_json(body);
  if (!hook) return problem(hook.error(), request);
  const std::string& tenant = request.principal.tenant;
  if (auto ok = parts_.webhooks.check(*hook, tenant); !ok) return problem(ok.error(), request);
  if (!webhook_tests_.try_acquire())
    return problem({"overloaded", "Too many webhooks are being tested.", {}}, request);
  const struct Release {
    std::counting_semaphore<>& slots;
    ~Release() { slots.release(); }
  } release{webhook_tests_};
  const auto began = std::chrono::steady_clock::now();
  const webhooks::Webhooks::Tested tested = parts_.webhooks.test(*hook, tenant);
  request.asleep += std::chrono::steady_clock::now() - began;
  nlohmann::json document{{"id", tested.id},
                          {"delivered", tested.answer.delivered()},
                          {"status", nullptr},
                          {"error", nullptr}};
  if (tested.answer.status != 0) document["status"] = tested.answer.status;
  if (!tested.answer.error.empty()) document["error"] = tested.answer.error;
  return http::json_response(202, document);
}

}  // namespace kiln::api
