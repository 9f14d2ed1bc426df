#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <stop_token>
#include <string>

#include "baker/exec/thread_pool.h"
#include "proto/expected.h"
#include "server/api/desk.h"
#include "server/api/scenes.h"
#include "server/base/cpu_meter.h"
#include "server/base/metrics.h"
#include "server/data/scene_store.h"
#include "server/http/message.h"
#include "server/jobs/admission.h"

namespace kiln::api {

/// Pairs of points of a stored scene.
struct VisibilityInput {
  data::StoredScene scene;
  int pairs = -1;  ///< descriptor of the file that holds them, as visibility::check_pairs() says
};

struct VisibilityAnswer {
  std::string bits;  ///< see visibility::Answer
  std::uint64_t pairs = 0, visible = 0;
  bool was_ready = false;                       ///< false for the request that made the scene so
  double ready_seconds = 0, trace_seconds = 0;  ///< until the scene was ready; then
};

struct VisibilityResult {
  proto::Expected<VisibilityAnswer> answer;
  double cpu_seconds = 0;  ///< taken by this process, whether it is an answer or an error
};
/// Tells which pairs see each other: server::make_visibility(), or a test's stand-in. Errors: those
/// of visibility::check_pairs() and of reading a scene, and `overloaded`.
using VisibilityFunction = std::function<VisibilityResult(const VisibilityInput&, exec::ThreadPool&,
                                                          const std::stop_token&)>;

/// The parts that the route of visibility works on.
struct Visibility {
  const Scenes& scenes;
  const VisibilityFunction& see;
  exec::ThreadPool& pool;
  Desk& desk;
  const jobs::Admission& admission;
  base::CpuMeter& cpu;
  base::Metrics& metrics;

  static constexpr std::size_t kAtOnce = 4, kInLine = 32;  ///< of the desk
};

http::Response post_visibility(const Visibility&, http::Request&);

}  // namespace kiln::api
