#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>

#include "proto/webhook.h"

namespace kiln::proto {

using Labels = std::map<std::string, std::string>;

/// The options that a client may set for a job beside its scene and settings.
struct JobOptions {
  static constexpr std::int32_t kMaxPriority = 100;  ///< -kMaxPriority is the least
  static constexpr std::uint64_t kMaxTtlSeconds = 10ull * 365 * 86'400;
  static constexpr std::size_t kMaxLabels = 32, kMaxLabelName = 63, kMaxLabelValue = 255;

  std::int32_t priority = 0;  ///< a higher one runs first; among equals, the oldest job
  Labels labels;              ///< names of [A-Za-z0-9._/-], values of any text
  std::optional<std::uint64_t> ttl_seconds;  ///< time that the job is kept after its end; 0:
                                             ///< forever; nothing: the service's default
  bool dedupe = true;                        ///< an identical bake that succeeded may answer
  std::optional<Webhook> webhook;            ///< the receiver of the job's events
};

/// A change to a job's options. Members without a value stay as they are.
struct JobPatch {
  std::optional<std::int32_t> priority;
  std::map<std::string, std::optional<std::string>> labels;  ///< nothing: the label is removed
  std::optional<std::uint64_t> ttl_seconds;
};

}  // namespace kiln::proto
