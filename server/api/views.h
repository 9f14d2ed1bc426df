#pragma once

#include <cstddef>
#include <filesystem>
#include <functional>
#include <stop_token>
#include <string>

#include "baker/exec/thread_pool.h"
#include "baker/view/view.h"
#include "proto/expected.h"
#include "server/api/desk.h"
#include "server/data/data_folder.h"
#include "server/http/message.h"
#include "server/jobs/job_lookup.h"

namespace kiln::api {

/// A picture of a finished job's results.
struct ViewInput {
  std::filesystem::path folder;  ///< of the results
  std::string lit_sha256;        ///< of their lit.glb
  view::Request request;
};
/// Draws the picture and returns it as PNG bytes: server::make_view(), or a test's stand-in.
/// Errors: those of view::draw() and of reading a scene, and `overloaded`.
using ViewFunction = std::function<proto::Expected<std::string>(const ViewInput&, exec::ThreadPool&,
                                                                std::stop_token)>;

/// The parts that the route of views works on.
struct Views {
  const jobs::JobLookup& lookup;
  const data::DataFolder& data;
  const ViewFunction& draw;
  exec::ThreadPool& pool;
  Desk& desk;

  static constexpr std::size_t kAtOnce = 2, kInLine = 32;  ///< of the desk
};

http::Response get_view(const Views&, http::Request&);

}  // namespace kiln::api
