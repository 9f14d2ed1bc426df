#pragma once

#include <filesystem>
#include <stop_token>

#include "baker/atlas/atlas.h"
#include "baker/import/import.h"
#include "baker/output/output.h"
#include "proto/expected.h"

namespace kiln::baker {

/// Reads the bytes of an upload for a bake: the scene in them, and lit.glb, which repeats most of
/// them. Everything that decodes such bytes is behind this interface, so that a service can have
/// another process do it. One thread uses it at a time.
class UploadReader {
 public:
  virtual ~UploadReader() = default;
  /// Imports the scene as import_files() does.
  virtual proto::Expected<scene::Scene> import(std::stop_token) = 0;
  /// Writes lit.glb as write_lit_glb() does. The scene is the one that import() returned. Errors:
  /// also `canceled`.
  virtual proto::Expected<void> write_lit(const std::filesystem::path&, const scene::Scene&,
                                          const atlas::Atlas&, const output::LitPages&,
                                          std::stop_token) = 0;
};

/// Reads the upload in this process.
class InProcessReader final : public UploadReader {
 public:
  explicit InProcessReader(files::SceneFiles files, files::ImportLimits limits = {})
      : files_(std::move(files)), limits_(limits) {}
  proto::Expected<scene::Scene> import(std::stop_token) override;
  proto::Expected<void> write_lit(const std::filesystem::path&, const scene::Scene&,
                                  const atlas::Atlas&, const output::LitPages&,
                                  std::stop_token) override;

 private:
  files::SceneFiles files_;
  files::ImportLimits limits_;
};

}  // namespace kiln::baker
