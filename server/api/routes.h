#pragma once

#include <string>
#include <utility>
#include <vector>

#include "server/api/capabilities.h"
#include "server/api/events.h"
#include "server/api/jobs.h"
#include "server/api/results.h"
#include "server/api/scenes.h"
#include "server/api/submit.h"
#include "server/api/uploads.h"
#include "server/api/views.h"
#include "server/api/visibility.h"
#include "server/api/webhooks.h"
#include "server/http/router.h"

namespace kiln::api {

/// The parts of all routes; each works on one of them.
struct Resources {
  Capabilities capabilities;
  Scenes scenes;
  Submit submit;
  Jobs jobs;
  Events events;
  Uploads uploads;
  WebhookTests webhook_tests;
  Results results;
  Views views;
  Visibility visibility;
};

/// Returns the router of the API; `resources` live longer than it.
http::Router make_router(const Resources&);

/// Returns method and pattern of every route of the API.
std::vector<std::pair<std::string, std::string>> api_routes();

}  // namespace kiln::api
