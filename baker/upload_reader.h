#pragma once

#include <filesystem>
#include <span>
#include <stop_token>

#include "baker/atlas/atlas.h"
#include "baker/import/import.h"
#include "baker/output/output.h"
#include "proto/expected.h"

namespace kiln::baker {

/// What a bake wants of the bytes of an upload: the scene in them, and lit.glb, which repeats the
/// most of them. Everything that decodes such bytes is behind this, so that a service can have it
/// done by another process. For one thread at a time.
class UploadReader {
 public:
  virtual ~UploadReader() = default;
  /// As import_files().
  virtual proto::Expected<scene::Scene> import(std::stop_token) = 0;
  /// As write_lit_glb(). The scene is the one that import() gave. Errors: also `canceled`.
  virtual proto::Expected<void> write_lit(const std::filesystem::path&, const scene::Scene&,
                                          const atlas::Atlas&, std::span<const output::LitPage>,
                                          std::stop_token) = 0;
};

/// In this process.
class InProcessReader final : public UploadReader {
 public:
  explicit InProcessReader(files::SceneFiles files, files::ImportLimits limits = {})
      : files_(std::move(files)), limits_(limits) {}
  proto::Expected<scene::Scene> import(std::stop_token) override;
  proto::Expected<void> write_lit(const std::filesystem::path&, const scene::Scene&,
                                  const atlas::Atlas&, std::span<const output::LitPage>,
                                  std::stop_token) override;

 private:
  files::SceneFiles files_;
  files::ImportLimits limits_;
};

}  // namespace kiln::baker
