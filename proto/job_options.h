#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>

#include "proto/webhook.h"

namespace kiln::proto {

using Labels = std::map<std::string, std::string>;

/// What a client may say of a job beside its scene and settings.
struct JobOptions {
  static constexpr std::int32_t kMaxPriority = 100;  ///< and -kMaxPriority
  static constexpr std::uint64_t kMaxTtlSeconds = 10ull * 365 * 86'400;
  static constexpr std::size_t kMaxLabels = 32, kMaxLabelName = 63, kMaxLabelValue = 255;

  std::int32_t priority = 0;                 ///< higher runs first; equal ones oldest first
  Labels labels;                             ///< names of [A-Za-z0-9._/-], values of any text
  std::optional<std::uint64_t> ttl_seconds;  ///< kept so long after its end; 0: for ever; nothing:
                                             ///< the service's default
  bool dedupe = true;                        ///< an identical bake that succeeded may answer
  std::optional<Webhook> webhook;            ///< who is told of the job's events
};

/// A change to a job's options: what is not there stays.
struct JobPatch {
  std::optional<std::int32_t> priority;
  std::map<std::string, std::optional<std::string>> labels;  ///< nothing: the label goes
  std::optional<std::uint64_t> ttl_seconds;
};

}  // namespace kiln::proto
