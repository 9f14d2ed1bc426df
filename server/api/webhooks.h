#pragma once

#include <semaphore>

#include "server/api/upload.h"
#include "server/http/message.h"
#include "server/webhooks/webhooks.h"

namespace kiln::api {

/// The parts that the test of a webhook works on.
struct WebhookTests {
  const webhooks::Webhooks& webhooks;
  Intake intake;
  std::counting_semaphore<>& slots;  ///< tests at a time
};

/// Sends one message and answers with what came of it. Holds a thread meanwhile.
http::Response test_webhook(const WebhookTests&, http::Request&);

}  // namespace kiln::api
