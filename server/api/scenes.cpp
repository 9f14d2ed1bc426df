#include <nlohmann/json.hpp>

#include "proto/json.h"
#include "server/api/api.h"
#include "server/http/problem.h"

namespace kiln::api {

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

http::Response Api::receive_scene(http::Request& request, SceneAnswer answer) {
  return receive_upload(
      request, parts_.data, {parts_.config.max_upload_bytes, parts_.config.max_request_json_bytes},
      /*for_job=*/false,
      [answer = std::move(answer)](http::Request& again, proto::Expected<Upload> upload) {
        if (!upload) return problem(upload.error(), again);
        return answer(again, std::make_shared<data::SceneUpload>(std::move(upload->scene)));
      });
}

// Container, JSON and accessors are checked here; what depends on the settings (a light, say) when
// a job names the scene.
http::Response Api::store_when_checked(http::Request& request,
                                       std::shared_ptr<data::SceneUpload> scene,
                                       StoreAnswer answer) {
  proto::BakeSettings any_light;
  any_light.allow_dark = true;
  const auto files = scene->files();
  return answer_when_checked(request, files, any_light,
                             [this, scene = std::move(scene), answer = std::move(answer)](
                                 http::Request& again, const proto::Expected<void>& checked) {
                               if (!checked)
                                 return answer(again, proto::Unexpected(checked.error()));
                               return answer(again, put_scene(again, std::move(*scene)));
                             });
}

http::Response Api::post_scene(http::Request& request) {
  return receive_scene(
      request, [this](http::Request& again, std::shared_ptr<data::SceneUpload> scene) {
        return store_when_checked(
            again, std::move(scene),
            [](http::Request& asked, const proto::Expected<data::SceneStore::Put>& put) {
              if (!put) return problem(put.error(), asked);
              return scene_response(put->created ? 201 : 200, put->scene)
                  .header("Location", scene_path(put->scene));
            });
      });
}

// The client says which scene it sends: what arrives has to be that one.
http::Response Api::put_scene_named(http::Request& request) {
  return receive_scene(
      request, [this](http::Request& again, std::shared_ptr<data::SceneUpload> scene) {
        const std::string key = identify_scene(scene->main->sha256, scene->side).key;
        if (key != again.parameters.at(0))
          return problem({"digest_mismatch", "What arrived is sha256:" + key + ".", {}}, again);
        return store_when_checked(
            again, std::move(scene),
            [](http::Request& asked, const proto::Expected<data::SceneStore::Put>& put) {
              return put ? scene_response(put->created ? 201 : 200, put->scene)
                         : problem(put.error(), asked);
            });
      });
}

proto::Expected<void> Api::check_owner(const http::Request& request,
                                       const std::string& scene) const {
  const base::Principal& client = request.principal;
  if (client.admin || parts_.store.owns_scene(scene, client.tenant)) return {};
  return proto::fail("not_found", "There is no scene sha256:" + scene + ".");
}

proto::Expected<data::SceneStore::Put> Api::put_scene(const http::Request& request,
                                                      data::SceneUpload&& upload) {
  auto put = parts_.scenes.put(std::move(upload));
  if (!put) return put;
  const std::string &key = put->scene.key, &tenant = request.principal.tenant;
  if (!tenant.empty() && !parts_.store.owns_scene(key, tenant))
    parts_.store.grant_scene(key, tenant);
  return put;
}

http::Response Api::get_scene(http::Request& request) {
  const std::string& key = request.parameters.at(0);
  if (auto ok = check_owner(request, key); !ok) return problem(ok.error(), request);
  auto scene = parts_.scenes.find(key);
  if (!scene) return problem(scene.error(), request);
  return scene_response(200, *scene);
}

}  // namespace kiln::api
