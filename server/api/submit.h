#pragma once

#include "server/api/scenes.h"
#include "server/http/message.h"
#include "server/jobs/job_lookup.h"
#include "server/jobs/job_submit.h"
#include "server/webhooks/webhooks.h"

namespace kiln::api {

/// The parts that POST /v1/jobs works on.
struct Submit {
  jobs::JobSubmitter& submitter;
  const jobs::JobLookup& lookup;
  const webhooks::Webhooks& webhooks;
  const Scenes& scenes;
};

http::Response post_job(const Submit&, http::Request&);

}  // namespace kiln::api
