#pragma once

#include <cstdint>

#include "server/api/scenes.h"
#include "server/data/upload_store.h"
#include "server/http/message.h"
#include "server/store/job_store.h"

namespace kiln::api {

/// The parts that the routes of uploads work on. Uploads can be resumed in the style of the IETF's
/// resumable uploads for HTTP and of tus.
struct Uploads {
  data::UploadStore& uploads;
  const store::JobStore& store;
  const Scenes& scenes;
  std::uint64_t max_bytes_per_tenant;  ///< of results and uploads; 0: no limit
};

http::Response post_upload(const Uploads&, http::Request&);
http::Response get_upload(const Uploads&, http::Request&);
http::Response patch_upload(const Uploads&, http::Request&);
http::Response delete_upload(const Uploads&, http::Request&);

}  // namespace kiln::api
