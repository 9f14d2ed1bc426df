#include "server/api/views.h"

#include <bit>
#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <utility>

#include "proto/sha256.h"
#include "server/api/request.h"
#include "server/api/results.h"
#include "server/http/problem.h"

namespace kiln::api {
namespace {

using proto::Expected;
using proto::Unexpected;

constexpr std::chrono::minutes kPatience(2);

Expected<bool> query_flag(const http::Request& request, const char* name) {
  const std::string* text = request.head.query_value(name);
  if (!text || *text == "false") return false;
  if (*text == "true") return true;
  return proto::fail("bad_request",
                     std::string("The query parameter `") + name + "` has to be true or false.",
                     "request", std::string("/query/") + name);
}

Expected<bool> query_nearest(const http::Request& request) {
  const std::string* text = request.head.query_value("filter");
  if (!text || *text == "bilinear") return false;
  if (*text == "nearest") return true;
  return proto::fail("bad_request", "The query parameter `filter` has to be nearest or bilinear.",
                     "request", "/query/filter");
}

Expected<view::Request> read_request(const http::Request& request) {
  if (auto ok =
          only_query(request, {"layer", "camera", "size", "exposure", "ortho", "shaded", "filter"});
      !ok)
    return Unexpected(ok.error());
  view::Request out;
  if (const auto* layer = request.head.query_value("layer")) out.layer = *layer;
  if (const auto* camera = request.head.query_value("camera")) out.camera = *camera;
  if (const auto* size = request.head.query_value("size")) {
    const auto read = view::parse_size(*size);
    if (!read) return Unexpected(read.error());
    out.size = *read;
  }
  const auto exposure = query_exposure(request);
  if (!exposure) return Unexpected(exposure.error());
  out.exposure = *exposure;
  const auto ortho = query_flag(request, "ortho"), shaded = query_flag(request, "shaded");
  if (!ortho) return Unexpected(ortho.error());
  if (!shaded) return Unexpected(shaded.error());
  const auto nearest = query_nearest(request);
  if (!nearest) return Unexpected(nearest.error());
  out.orthographic = *ortho;
  out.shaded = *shaded;
  out.nearest = *nearest;
  if (auto ok = view::check(out); !ok) return Unexpected(ok.error());
  return out;
}

/// Names the picture by all that it depends on.
std::string etag_of(const view::Request& r, const std::string& manifest, const std::string& lit) {
  std::string text = manifest + lit;
  for (const std::string& part :
       {std::string(LIGHTKILN_VERSION), r.layer, r.camera, std::to_string(r.size.width),
        std::to_string(r.size.height), std::to_string(r.orthographic), std::to_string(r.nearest),
        std::to_string(r.shaded),
        r.exposure ? std::to_string(std::bit_cast<std::uint32_t>(*r.exposure)) : "auto"})
    text += "\n" + part;
  return "\"" + proto::sha256_hex(text).substr(0, 32) + "\"";
}

http::Response picture(http::Request& request, const std::string& etag, Expected<std::string> png) {
  if (!png) return problem(png.error(), request);
  http::Response response;
  response.content_type = "image/png";
  response.body = std::move(*png);
  return response.header("ETag", etag).header("Cache-Control", "private, no-cache");
}

}  // namespace

http::Response get_view(const Views& part, http::Request& request) {
  auto wanted = read_request(request);
  if (!wanted) return problem(wanted.error(), request);
  auto job = find_finished(part.lookup, request);
  if (!job) return problem(job.error(), request);
  std::string manifest, lit;
  for (const proto::ResultFile& file : part.lookup.results(job->id)) {
    if (file.name == "manifest.json") manifest = file.sha256;
    if (file.name == "lit.glb") lit = file.sha256;
  }
  if (lit.empty())
    return problem({"not_found",
                    "Job " + job->id +
                        " has no lit.glb, which a view shows: bake with `glb` among "
                        "`output.formats`.",
                    {}},
                   request);
  const std::string etag = etag_of(*wanted, manifest, lit);
  if (client_has(request, etag)) return not_modified(etag);
  if (!part.desk.has_room())
    return problem({"overloaded", "Too many views are being drawn.", {}}, request);
  const ViewInput input{part.data.results(job->id), lit, std::move(*wanted)};
  const auto png = std::make_shared<std::optional<Expected<std::string>>>();
  return part.desk.answer(
      [&draw = part.draw, &pool = part.pool, input, png](const std::stop_token& stop) {
        *png = draw(input, pool, stop);
      },
      [etag, png](http::Request& again) { return picture(again, etag, std::move(**png)); },
      kPatience, "The view was not drawn in time.");
}

}  // namespace kiln::api
