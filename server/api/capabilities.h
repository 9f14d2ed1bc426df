#pragma once

#include <cstdint>

#include "server/base/config.h"
#include "server/data/upload_store.h"
#include "server/http/message.h"
#include "server/jobs/admission.h"

namespace kiln::api {

/// The parts that the service describes itself by.
struct Capabilities {
  const base::ServerConfig& config;
  const jobs::Admission& admission;
  const data::UploadStore& uploads;
  unsigned bake_threads;
  std::uint64_t import_memory_bytes;  ///< that reading one scene may take; 0: no limit
};

/// Version, methods, settings, limits, and what the client's tenant has used of them.
http::Response get_capabilities(const Capabilities&, http::Request&);
/// A hint for people, as text.
http::Response get_root(const Capabilities&, http::Request&);
http::Response get_openapi(const Capabilities&, http::Request&);

}  // namespace kiln::api
