#include "server/api/uploads.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <nlohmann/json.hpp>

#include "server/api/request.h"
#include "server/base/ids.h"
#include "server/http/body.h"
#include "server/http/problem.h"

namespace kiln::api {
namespace {

using proto::Expected;
using proto::fail;
using PieceAnswer = std::function<http::Response(http::Request&, http::Response)>;

std::string upload_path(const data::PartialUpload& upload) {
  return "/v1/uploads/" + upload.id;
}

http::Response with_progress(http::Response response, const data::PartialUpload& upload) {
  response.header("Upload-Offset", std::to_string(upload.offset))
      .header("Upload-Length", std::to_string(upload.length))
      .header("Upload-Complete", upload.complete() ? "?1" : "?0");
  return response;
}

http::Response upload_response(int status, const data::PartialUpload& upload) {
  nlohmann::json document{{"id", upload.id},
                          {"offset", upload.offset},
                          {"length", upload.length},
                          {"complete", upload.complete()},
                          {"expires_at", upload.expires_at},
                          {"scene", nullptr},
                          {"links", {{"self", upload_path(upload)}}}};
  if (!upload.scene.empty()) document["scene"] = "sha256:" + upload.scene;
  return with_progress(http::json_response(status, document), upload);
}

proto::Unexpected missing_header(const char* name, const char* what) {
  return fail("bad_request", std::string("The header ") + name + " is missing: " + what + ".",
              "request", std::string("/headers/") + name);
}

Expected<data::PartialUpload> find_upload(const Uploads& part, const http::Request& request) {
  const std::string& id = request.parameters.at(0);
  if (!base::is_id(id, "upl_")) return fail("not_found", "There is no upload " + id + ".");
  return part.uploads.look(id, request.principal.tenant, request.principal.admin);
}

Expected<data::PartialUpload> wanted_upload(const Uploads& part, const http::Request& request) {
  data::PartialUpload wanted;
  wanted.tenant = request.principal.tenant;
  auto name = idempotency_key(request);
  if (!name) return proto::Unexpected(name.error());
  wanted.name = std::move(*name);
  auto length = header_number(request, "upload-length");
  if (!length) return proto::Unexpected(length.error());
  if (!*length) return missing_header("upload-length", "the bytes of the whole");
  wanted.length = **length;
  if (wanted.length == 0)
    return fail("invalid_request", "An upload needs a byte.", "request", "/headers/upload-length");
  if (wanted.length > part.scenes.intake.limits.body_bytes)
    return fail("payload_too_large", "The upload is over the limit of " +
                                         std::to_string(part.scenes.intake.limits.body_bytes) +
                                         " bytes.");
  const std::string* type = request.head.header("content-type");
  wanted.content_type = type ? *type : "application/octet-stream";
  if (const std::string* digest = request.head.header("repr-digest")) wanted.digest = *digest;
  if (!is_scene_type(media_type(request.head)))
    return fail("unsupported_media_type",
                "The Content-Type is that of the whole: model/gltf-binary, model/gltf+json, "
                "multipart/form-data or application/octet-stream.");
  return wanted;
}

// Gives the answer to the last piece again, which was lost.
http::Response finished_upload(const Uploads& part, http::Request& request,
                               const data::PartialUpload& upload) {
  auto scene = part.scenes.scenes.use(upload.scene);
  if (!scene) return problem(scene.error(), request);
  return with_progress(scene_response(200, *scene).header("Location", scene_path(*scene)), upload);
}

// Reads the file of a whole upload as POST /v1/scenes would read it as a body.
Expected<Upload> read_upload(const Uploads& part, const data::PartialUpload& upload) {
  constexpr std::size_t kPiece = std::size_t{256} * 1024;
  const auto path = part.uploads.file(upload.id);
  const proto::Fd file(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
  if (!file.valid()) return proto::storage_error("open", path);
  http::RequestHead head;
  head.headers = {{"Content-Type", upload.content_type}};
  if (!upload.digest.empty()) head.headers.emplace_back("Content-Digest", upload.digest);
  auto receiver = UploadReceiver::begin(head, part.scenes.intake, /*for_job=*/false);
  if (!receiver) return proto::Unexpected(receiver.error());
  http::DigestCheck digest(head);
  std::string buffer(kPiece, '\0');
  for (;;) {
    const ssize_t got = ::read(file.get(), buffer.data(), buffer.size());
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) return proto::storage_error("read", path);
    if (got == 0) break;
    const std::string_view bytes(buffer.data(), static_cast<std::size_t>(got));
    digest.update(bytes);
    if (auto taken = (*receiver)->take(bytes); !taken) return proto::Unexpected(taken.error());
  }
  if (auto same = digest.finish(); !same) return proto::Unexpected(same.error());
  return (*receiver)->finish();
}

// Does with the whole what POST /v1/scenes does with a body.
http::Response finish_upload(const Uploads& part, http::Request& request,
                             const data::PartialUpload& upload) {
  const auto answer = [&part, upload](http::Request& again,
                                      const proto::Expected<data::SceneStore::Put>& put) {
    if (!put) {
      // A scene that its sender has to change can't be mended by sending more of it.
      const auto& code = put.error().code;
      if (code != "storage_full" && code != "io_error" && code != "overloaded")
        part.uploads.remove(upload.id);
      return problem(put.error(), again);
    }
    if (auto ok = part.uploads.finished(upload.id, put->scene.key); !ok)
      return problem(ok.error(), again);
    return with_progress(scene_response(put->created ? 201 : 200, put->scene)
                             .header("Location", scene_path(put->scene)),
                         upload);
  };
  auto read = read_upload(part, upload);
  if (read)
    return store_when_checked(part.scenes, request,
                              std::make_shared<data::SceneUpload>(std::move(read->scene)), answer);
  // Another request for the same upload may have been faster.
  const base::Principal& client = request.principal;
  if (auto now = part.uploads.look(upload.id, client.tenant, client.admin);
      now && !now->scene.empty())
    return finished_upload(part, request, *now);
  return answer(request, proto::Unexpected(read.error()));
}

http::Response answer_piece(const Uploads& part, http::Request& request,
                            data::UploadStore::Appender& appender, const Expected<void>& taken) {
  auto upload = appender.finish();
  if (!upload) return problem(upload.error(), request);
  if (!taken) return with_progress(problem(taken.error(), request), *upload);
  if (upload->complete()) return finish_upload(part, request, *upload);
  return with_progress(no_content(), *upload);
}

// Receives the body into the upload. What has arrived is kept, however the request ends.
http::Response append_to_upload(const Uploads& part, http::Request& request,
                                const data::PartialUpload& before, PieceAnswer answer) {
  if (!before.scene.empty()) return answer(request, finished_upload(part, request, before));
  auto appended = part.uploads.append(before.id, before.offset);
  if (!appended) return answer(request, problem(appended.error(), request));
  const auto appender = std::make_shared<data::UploadStore::Appender>(std::move(*appended));
  if (request.head.content_length.value_or(0) > before.length - before.offset)
    return answer(request, answer_piece(part, request, *appender,
                                        fail("payload_too_large",
                                             "The upload has " + std::to_string(before.length) +
                                                 " bytes, not more.")));
  http::Response response;
  response.receive = http::Receive{
      before.length, [appender](std::string_view bytes) { return appender->write(bytes); },
      [&part, appender, answer = std::move(answer)](http::Request& again,
                                                    const Expected<void>& taken) {
        return answer(again, answer_piece(part, again, *appender, taken));
      }};
  return response;
}

}  // namespace

http::Response post_upload(const Uploads& part, http::Request& request) {
  auto wanted = wanted_upload(part, request);
  if (!wanted) return problem(wanted.error(), request);
  const std::string& tenant = wanted->tenant;
  if (part.max_bytes_per_tenant > 0 &&
      part.store.result_bytes(tenant) + part.uploads.bytes(tenant) + wanted->length >
          part.max_bytes_per_tenant)
    return problem({"quota_exceeded",
                    "With this upload the tenant's results and uploads would be over " +
                        std::to_string(part.max_bytes_per_tenant) + " bytes.",
                    {}},
                   request);
  auto opened = part.uploads.open(*wanted);
  if (!opened) return problem(opened.error(), request);
  const int status = opened->created ? 201 : 200;
  if (!request.head.has_body() || !opened->created)
    return upload_response(status, opened->upload).header("Location", upload_path(opened->upload));
  return append_to_upload(
      part, request, opened->upload,
      [path = upload_path(opened->upload)](http::Request&, http::Response response) {
        if (response.status == 204) response.status = 201;
        if (response.status == 201 && response.body.empty()) response.header("Location", path);
        return response;
      });
}

http::Response get_upload(const Uploads& part, http::Request& request) {
  auto upload = find_upload(part, request);
  if (!upload) return problem(upload.error(), request);
  return upload_response(200, *upload);
}

http::Response delete_upload(const Uploads& part, http::Request& request) {
  auto upload = find_upload(part, request);
  if (!upload) return problem(upload.error(), request);
  part.uploads.remove(upload->id);
  return no_content();
}

http::Response patch_upload(const Uploads& part, http::Request& request) {
  auto upload = find_upload(part, request);
  if (!upload) return problem(upload.error(), request);
  auto offset = header_number(request, "upload-offset");
  if (!offset) return problem(offset.error(), request);
  if (!*offset)
    return problem(missing_header("upload-offset", "the bytes before this part").value(), request);
  if (**offset != upload->offset)
    return with_progress(
        problem({"offset_mismatch",
                 "The upload has " + std::to_string(upload->offset) + " bytes: go on there.",
                 {}},
                request),
        *upload);
  return append_to_upload(part, request, *upload,
                          [](http::Request&, http::Response response) { return response; });
}

}  // namespace kiln::api
