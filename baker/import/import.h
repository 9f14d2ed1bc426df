#pragma once

#include <memory>
#include <optional>
#include <stop_token>
#include <string>

#include "baker/files/upload.h"
#include "baker/scene/scene.h"
#include "proto/bake_settings.h"
#include "proto/expected.h"

namespace kiln::import {

/// A scene whose document was read: container, JSON, accessors' ranges and the graph of its nodes
/// were checked. It can be checked and then imported without a second look at the document's text.
/// For one thread at a time.
class OpenedScene {
 public:
  /// Errors: `invalid_scene` (pointer into the glTF), `unsupported_extension`, `missing_file`,
  /// `limit_exceeded`, `canceled`.
  static proto::Expected<OpenedScene> open(const files::SceneFiles&, const files::ImportLimits&,
                                           const std::stop_token&);
  OpenedScene(OpenedScene&&) noexcept;
  ~OpenedScene();

  /// Does what check_scene() says.
  proto::Expected<void> check(const proto::BakeSettings&, const std::stop_token&);
  /// Does what import_files() says; `sky_map` names the side file that is the sky map. Called once.
  proto::Expected<scene::Scene> import(const std::optional<std::string>& sky_map,
                                       const std::stop_token&);

 private:
  struct Parts;
  explicit OpenedScene(std::unique_ptr<Parts>);
  std::unique_ptr<Parts> parts_;
};

/// Reads and checks everything short of decoding images: container, JSON, graph, accessors, and
/// that something can be baked. The sky map is the one that the settings name. Fast enough for a
/// request (50 MB within a second). Errors: `invalid_scene` (pointer into the glTF),
/// `unsupported_extension`, `missing_file`, `nothing_to_bake`, `no_light`, `limit_exceeded`,
/// `invalid_image` (of the sky map), `canceled`.
proto::Expected<void> check_scene(const files::SceneFiles&, const proto::BakeSettings&,
                                  const files::ImportLimits& = {}, std::stop_token = {});

/// The import without what settings add: geometry, materials, punctual lights, images and the sky
/// map that the files name, decoded. Same errors but `no_light`, and `invalid_image`. What is legal
/// but not honored becomes a Scene::warning.
proto::Expected<scene::Scene> import_files(const files::SceneFiles&,
                                           const files::ImportLimits& = {}, std::stop_token = {});

/// Adds the lights and the sky of the settings to an imported scene. A sky map that gives no light
/// is dropped. Errors: `invalid_settings`, `no_light`; `missing_file` when the settings name a sky
/// map and the import had none; `canceled`.
proto::Expected<void> apply_settings(scene::Scene&, const proto::BakeSettings&,
                                     std::stop_token = {});

/// Does both and returns the scene that is baked.
proto::Expected<scene::Scene> import_scene(const files::SceneFiles&, const proto::BakeSettings&,
                                           const files::ImportLimits& = {}, std::stop_token = {});

/// Returns a name for the outcome of an import, 64 hexadecimal digits, from the importer, its
/// limits, the content of all files, and which of them is the sky map.
std::string import_key(const std::string& scene_key, const files::ImportLimits&,
                       const std::optional<std::string>& sky_map = {});

}  // namespace kiln::import
