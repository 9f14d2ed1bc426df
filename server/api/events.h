#pragma once

#include "server/http/message.h"
#include "server/jobs/event_feeds.h"
#include "server/jobs/job_lookup.h"

namespace kiln::api {

/// The parts that event streams work on.
struct Events {
  const jobs::JobLookup& lookup;
  jobs::EventFeeds& feeds;
};

http::Response get_events(const Events&, http::Request&);
http::Response get_all_events(const Events&, http::Request&);

}  // namespace kiln::api
