#pragma once

#include <functional>
#include <memory>
#include <string>

#include "baker/files/upload.h"
#include "proto/bake_settings.h"
#include "proto/expected.h"
#include "server/api/upload.h"
#include "server/data/scene_store.h"
#include "server/http/message.h"
#include "server/store/job_store.h"

namespace kiln::api {

/// Checks a scene: import::check_scene(), sandbox::Importer::check(), or a test's stand-in.
using CheckFunction =
    std::function<proto::Expected<void>(const files::SceneFiles&, const proto::BakeSettings&)>;

/// Calls `wake` once when a check that was refused as `overloaded` may do better; ends with what it
/// returns.
using WatchFunction = std::function<std::shared_ptr<const void>(std::function<void()> wake)>;

struct SceneCheck {
  CheckFunction check;
  WatchFunction watch;  ///< may be null
};

/// The parts that the routes of scenes work on.
struct Scenes {
  const data::SceneStore& scenes;
  store::JobStore& owners;
  SceneCheck check;
  Intake intake;
};

http::Response post_scene(const Scenes&, http::Request&);
http::Response put_scene_named(const Scenes&, http::Request&);
http::Response get_scene(const Scenes&, http::Request&);

/// Answers with a scene.
http::Response scene_response(int status, const data::StoredScene&);
std::string scene_path(const data::StoredScene&);

/// Returns whether the client uploaded this scene, or may see it. Errors: `not_found`.
proto::Expected<void> check_owner(const Scenes&, const http::Request&, const std::string& scene);
/// Puts a scene into the store, as one of the client's.
proto::Expected<data::SceneStore::Put> put_scene(const Scenes&, const http::Request&,
                                                 data::SceneUpload&&);

using CheckAnswer =
    std::function<http::Response(http::Request&, const proto::Expected<void>& checked)>;
/// Checks a scene. While too many others are being read the request waits without a thread, for
/// half a minute; then it is `overloaded`.
http::Response answer_when_checked(const SceneCheck&, http::Request&, const files::SceneFiles&,
                                   const proto::BakeSettings&, CheckAnswer);
using StoreAnswer =
    std::function<http::Response(http::Request&, const proto::Expected<data::SceneStore::Put>&)>;
/// Puts a scene into the store when it has passed the check.
http::Response store_when_checked(const Scenes&, http::Request&, std::shared_ptr<data::SceneUpload>,
                                  StoreAnswer);

}  // namespace kiln::api
