#include "server/api/scenes.h"

#include <algorithm>
#include <chrono>
#include <nlohmann/json.hpp>
#include <utility>

#include "server/http/problem.h"

namespace kiln::api {
namespace {

using Clock = std::chrono::steady_clock;
using SceneAnswer =
    std::function<http::Response(http::Request&, std::shared_ptr<data::SceneUpload>)>;

// Receives a scene and answers with it, or with what is wrong.
http::Response receive_scene(const Scenes& part, http::Request& request, SceneAnswer answer) {
  return receive_upload(
      request, part.intake, /*for_job=*/false,
      [answer = std::move(answer)](http::Request& again, proto::Expected<Upload> upload) {
        if (!upload) return problem(upload.error(), again);
        return answer(again, std::make_shared<data::SceneUpload>(std::move(upload->scene)));
      });
}

http::Response answer_until(const SceneCheck& check, http::Request& request,
                            const files::SceneFiles& files, const proto::BakeSettings& settings,
                            CheckAnswer answer, Clock::time_point until) {
  // A request that finds the line full asks again when the line has moved, or after this time.
  constexpr auto kAskAgain = std::chrono::milliseconds(100);
  const auto checked = check.check(files, settings);
  const auto now = Clock::now();
  if (checked || checked.error().code != "overloaded" || now >= until)
    return answer(request, checked);
  http::Response response;
  response.deferred = http::Deferred{
      std::min(until, now + kAskAgain),
      [&check](std::function<void()> wake) {
        return check.watch ? check.watch(std::move(wake)) : nullptr;
      },
      [&check, files, settings, answer = std::move(answer), until](http::Request& again) {
        return answer_until(check, again, files, settings, answer, until);
      }};
  return response;
}

}  // namespace

std::string scene_path(const data::StoredScene& scene) {
  return "/v1/scenes/sha256:" + scene.key;
}

http::Response scene_response(int status, const data::StoredScene& scene) {
  return http::json_response(status, {{"id", "sha256:" + scene.key},
                                      {"sha256", scene.main_sha256},
                                      {"bytes", scene.bytes},
                                      {"side_files", scene.side_files},
                                      {"links", {{"self", scene_path(scene)}}}});
}

http::Response answer_when_checked(const SceneCheck& check, http::Request& request,
                                   const files::SceneFiles& files,
                                   const proto::BakeSettings& settings, CheckAnswer answer) {
  constexpr auto kPatience = std::chrono::seconds(30);
  return answer_until(check, request, files, settings, std::move(answer), Clock::now() + kPatience);
}

// The check looks at container, JSON and accessors; what depends on the settings (a light, say) is
// checked when a job names the scene.
http::Response store_when_checked(const Scenes& part, http::Request& request,
                                  std::shared_ptr<data::SceneUpload> scene, StoreAnswer answer) {
  proto::BakeSettings any_light;
  any_light.allow_dark = true;
  const auto files = scene->files();
  return answer_when_checked(part.check, request, files, any_light,
                             [&part, scene = std::move(scene), answer = std::move(answer)](
                                 http::Request& again, const proto::Expected<void>& checked) {
                               if (!checked)
                                 return answer(again, proto::Unexpected(checked.error()));
                               return answer(again, put_scene(part, again, std::move(*scene)));
                             });
}

http::Response post_scene(const Scenes& part, http::Request& request) {
  return receive_scene(
      part, request, [&part](http::Request& again, std::shared_ptr<data::SceneUpload> scene) {
        return store_when_checked(
            part, again, std::move(scene),
            [](http::Request& asked, const proto::Expected<data::SceneStore::Put>& put) {
              if (!put) return problem(put.error(), asked);
              return scene_response(put->created ? 201 : 200, put->scene)
                  .header("Location", scene_path(put->scene));
            });
      });
}

// The client says which scene it sends: what arrives has to be that one.
http::Response put_scene_named(const Scenes& part, http::Request& request) {
  return receive_scene(
      part, request, [&part](http::Request& again, std::shared_ptr<data::SceneUpload> scene) {
        const std::string key = identify_scene(scene->main->sha256, scene->side).key;
        if (key != again.parameters.at(0))
          return problem({"digest_mismatch", "What arrived is sha256:" + key + ".", {}}, again);
        return store_when_checked(
            part, again, std::move(scene),
            [](http::Request& asked, const proto::Expected<data::SceneStore::Put>& put) {
              return put ? scene_response(put->created ? 201 : 200, put->scene)
                         : problem(put.error(), asked);
            });
      });
}

proto::Expected<void> check_owner(const Scenes& part, const http::Request& request,
                                  const std::string& scene) {
  const base::Principal& client = request.principal;
  if (client.admin || part.owners.owns_scene(scene, client.tenant)) return {};
  return proto::fail("not_found", "There is no scene sha256:" + scene + ".");
}

proto::Expected<data::SceneStore::Put> put_scene(const Scenes& part, const http::Request& request,
                                                 data::SceneUpload&& upload) {
  auto put = part.scenes.put(std::move(upload));
  if (!put) return put;
  const std::string &key = put->scene.key, &tenant = request.principal.tenant;
  if (!tenant.empty() && !part.owners.owns_scene(key, tenant)) part.owners.grant_scene(key, tenant);
  return put;
}

http::Response get_scene(const Scenes& part, http::Request& request) {
  const std::string& key = request.parameters.at(0);
  if (auto ok = check_owner(part, request, key); !ok) return problem(ok.error(), request);
  auto scene = part.scenes.find(key);
  if (!scene) return problem(scene.error(), request);
  return scene_response(200, *scene);
}

}  // namespace kiln::api
