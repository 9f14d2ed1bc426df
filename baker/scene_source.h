#pragma once

#include <filesystem>
#include <span>
#include <stop_token>

#include "baker/atlas/atlas.h"
#include "baker/scene/import.h"
#include "proto/expected.h"

namespace kiln::baker {

struct LitPage;

/// What a bake wants of the bytes of an upload: the scene in them, and lit.glb, which repeats the
/// most of them. Everything that decodes such bytes is behind this, so that a service can have it
/// done by another process. For one thread at a time.
class SceneSource {
 public:
  virtual ~SceneSource() = default;
  /// As import_files().
  virtual proto::Expected<Scene> import(std::stop_token) = 0;
  /// As write_lit_glb(). The scene is the one that import() gave. Errors: also `canceled`.
  virtual proto::Expected<void> write_lit(const std::filesystem::path&, const Scene&, const Atlas&,
                                          std::span<const LitPage>, std::stop_token) = 0;
};

/// In this process.
class FilesInProcess final : public SceneSource {
 public:
  explicit FilesInProcess(SceneFiles files, ImportLimits limits = {})
      : files_(std::move(files)), limits_(limits) {}
  proto::Expected<Scene> import(std::stop_token) override;
  proto::Expected<void> write_lit(const std::filesystem::path&, const Scene&, const Atlas&,
                                  std::span<const LitPage>, std::stop_token) override;

 private:
  SceneFiles files_;
  ImportLimits limits_;
};

}  // namespace kiln::baker
