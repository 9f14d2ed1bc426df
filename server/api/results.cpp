#include "server/api/results.h"

#include <fcntl.h>

#include <charconv>
#include <cmath>
#include <nlohmann/json.hpp>

#include "baker/output/output.h"
#include "baker/output/post.h"
#include "proto/json.h"
#include "proto/sha256.h"
#include "server/api/jobs.h"
#include "server/api/request.h"
#include "server/api/zip.h"
#include "server/base/ids.h"
#include "server/http/conditional.h"
#include "server/http/problem.h"
#include "server/jobs/job_log.h"

namespace kiln::api {
namespace {

using proto::Expected;
using proto::fail;

constexpr std::uint64_t kMaxManifestBytes = 256ull << 20;

http::Response unsatisfiable(std::uint64_t size, const http::Request& request) {
  const proto::Error error{
      "range_not_satisfiable",
      "The file has " + std::to_string(size) + " bytes; one range within them can be had.",
      {}};
  return problem(error, request).header("Content-Range", "bytes */" + std::to_string(size));
}

// Answers with immutable content under a strong ETag: all of it, a range, or 304 and 416.
http::Response content_response(const http::Request& request, const std::string& etag,
                                const http::Content& content) {
  const std::uint64_t size = length_of(content);
  const http::Selection selection = select_content(request.head, etag, size);
  if (selection.status == 304) return not_modified(etag);
  if (selection.status == 416) return unsatisfiable(size, request);
  http::Response response;
  response.status = selection.status;
  response.content = slice(content, selection.offset, selection.length);
  response.header("ETag", etag)
      .header("Accept-Ranges", "bytes")
      .header("Cache-Control", "private, max-age=31536000, immutable");
  if (selection.status == 206)
    response.header("Content-Range", "bytes " + std::to_string(selection.offset) + "-" +
                                         std::to_string(selection.offset + selection.length - 1) +
                                         "/" + std::to_string(size));
  return response;
}

// Returns the name and its page number for page_07.exr, when settings asked for EXR files.
std::string exr_name(std::uint64_t page) {
  const std::string digits = std::to_string(page);
  return "page_" + std::string(digits.size() < 2 ? "0" : "") + digits + ".exr";
}

// Returns the log of a job without results: one that runs or failed. Nothing: there is none yet.
std::optional<http::Response> log_response(const data::DataFolder& data, const std::string& id) {
  auto text = proto::read_file(jobs::JobLog::path(data, id), jobs::JobLog::kMaxBytes);
  if (!text) return std::nullopt;
  http::Response response;
  response.content_type = "text/plain; charset=utf-8";
  response.body = std::move(*text);
  response.header("Cache-Control", "no-store");
  return response;
}

proto::Expected<std::shared_ptr<const proto::Fd>> open_result(const data::DataFolder& data,
                                                              const std::string& id,
                                                              const proto::ResultFile& file) {
  const auto path = data.results(id) / file.name;
  auto fd = std::make_shared<const proto::Fd>(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
  if (!fd->valid()) return proto::storage_error("open", path);
  return fd;
}

// Returns a page of the running bake's latest pass, or of the finished result, as PNG bytes.
Expected<std::string> render_preview(const Results& part, const http::Request& request,
                                     const proto::Job& job, const baker::Snapshot& snapshot) {
  auto page = query_number(request, "page", UINT32_MAX);
  if (!page) return proto::Unexpected(page.error());
  auto exposure = query_exposure(request);
  if (!exposure) return proto::Unexpected(exposure.error());
  const std::uint64_t number = page->value_or(0);
  const auto no_page = [&] {
    return proto::fail("not_found",
                       "Job " + job.id + " has no page " + std::to_string(number) + ".");
  };
  image::PageImage image;
  if (snapshot.light) {
    if (number >= snapshot.texels->pages.size()) return no_page();
    image = output::compose_page(
        *snapshot.texels, static_cast<std::uint32_t>(number),
        [&](std::uint32_t t) { return snapshot.light->irradiance(t); }, job.settings.post.dilate);
  } else {
    const std::string name = exr_name(number);
    const auto files = part.lookup.results(job.id);
    if (std::none_of(files.begin(), files.end(), [&](const auto& f) { return f.name == name; }))
      return no_page();
    auto read = image::read_exr(part.data.results(job.id) / name);
    if (!read) return proto::Unexpected(read.error());
    image = std::move(*read);
  }
  const proto::OutputSettings& asked = job.settings.output;
  const output::Tone tone =
      output::tone_of(image, *exposure ? *exposure : asked.exposure, asked.tone_curve);
  return image::encode_png(output::tone_map(image, tone), image.width, image.height);
}

}  // namespace

proto::Expected<proto::Job> find_finished(const jobs::JobLookup& lookup,
                                          const http::Request& request) {
  auto job = find_job(lookup, request);
  if (!job || job->state == proto::JobState::kSucceeded) return job;
  // A bake that was canceled with `drain` has the light of its passes.
  if (job->state == proto::JobState::kCanceled && !lookup.results(job->id).empty()) return job;
  if (!proto::is_terminal(job->state))
    return proto::fail("result_not_ready", "Job " + job->id + " is not over yet.");
  return proto::fail(
      "not_found", "Job " + job->id + " " + proto::to_string(job->state) + ": it has no results.");
}

proto::Expected<std::optional<float>> query_exposure(const http::Request& request) {
  const std::string* text = request.head.query_value("exposure");
  if (!text) return std::nullopt;
  float value = 0;
  const auto parsed = std::from_chars(text->data(), text->data() + text->size(), value);
  if (parsed.ec != std::errc() || parsed.ptr != text->data() + text->size() || !(value > 0) ||
      !std::isfinite(value))
    return proto::fail("bad_request", "`exposure` has to be a number over 0.", "request",
                       "/query/exposure");
  return value;
}

http::Response get_results(const Results& part, http::Request& request) {
  auto job = find_finished(part.lookup, request);
  if (!job) return problem(job.error(), request);
  auto text = proto::read_file(part.data.results(job->id) / "manifest.json", kMaxManifestBytes);
  if (!text) return problem(text.error(), request);
  auto manifest = proto::parse_json(*text, "manifest");
  if (!manifest) return problem({"internal", "The manifest can't be read.", {}}, request);
  auto files = nlohmann::json::array();
  std::string etag;
  for (const auto& file : part.lookup.results(job->id)) {
    files.push_back({{"name", file.name},
                     {"media_type", file.media_type},
                     {"bytes", file.bytes},
                     {"sha256", file.sha256},
                     {"href", "/v1/jobs/" + job->id + "/results/" + file.name}});
    if (file.name == "manifest.json") etag = "\"" + file.sha256 + "-list\"";
  }
  if (client_has(request, etag)) return not_modified(etag);
  (*manifest)["files"] = std::move(files);
  return http::json_response(200, *manifest).header("ETag", etag);
}

http::Response get_result(const Results& part, http::Request& request) {
  auto job = find_finished(part.lookup, request);
  if (!job && request.parameters.at(1) == "log.txt")
    if (const auto any = find_job(part.lookup, request))
      if (auto log = log_response(part.data, any->id)) return std::move(*log);
  if (!job) return problem(job.error(), request);
  const std::string& name = request.parameters.at(1);
  // Only names that the store lists are ever turned into a path.
  const auto files = part.lookup.results(job->id);
  const auto found = std::find_if(files.begin(), files.end(),
                                  [&](const proto::ResultFile& f) { return f.name == name; });
  if (found == files.end())
    return problem({"not_found", "Job " + job->id + " has no result " + name + ".", {}}, request);

  auto file = open_result(part.data, job->id, *found);
  if (!file) return problem(file.error(), request);
  http::Response response =
      content_response(request, "\"" + found->sha256 + "\"",
                       {http::ContentPart::of(std::move(*file), found->bytes)});
  if (response.status >= 300) return response;
  response.content_type = found->media_type;
  const bool shown =
      found->media_type.starts_with("image/png") || found->media_type.starts_with("text/plain");
  return response.header("Content-Disposition", std::string(shown ? "inline" : "attachment") +
                                                    "; filename=\"" + name + "\"");
}

// Answers with all files at once. The name of the whole follows from the names and digests of its
// parts.
http::Response get_results_zip(const Results& part, http::Request& request) {
  auto job = find_finished(part.lookup, request);
  if (!job) return problem(job.error(), request);
  std::vector<ZipEntry> entries;
  proto::Sha256 identity;
  for (const auto& result : part.lookup.results(job->id)) {
    auto file = open_result(part.data, job->id, result);
    if (!file) return problem(file.error(), request);
    entries.push_back({result.name, std::move(*file), result.bytes});
    identity.update(result.name + "\n" + result.sha256 + "\n");
  }
  auto archive = zip_of(entries);
  if (!archive) return problem(archive.error(), request);
  http::Response response = content_response(request, "\"" + identity.hex() + "\"", *archive);
  if (response.status >= 300) return response;
  response.content_type = "application/zip";
  return response.header("Content-Disposition", "attachment; filename=\"" + job->id + ".zip\"");
}

http::Response get_preview(const Results& part, http::Request& request) {
  auto job = find_job(part.lookup, request);
  if (!job) return problem(job.error(), request);
  if (const auto* pass = request.head.query_value("pass"); pass && *pass != "latest")
    return problem({"bad_request",
                    "Only pass=latest can be had.",
                    {{"request", "/query/pass", "not `latest`"}}},
                   request);
  const baker::Snapshot snapshot = part.lookup.snapshot(job->id);
  if (!snapshot.light) {
    // The job may have ended between the two looks.
    if (auto finished = find_finished(part.lookup, request); !finished)
      return problem(finished.error(), request);
  }
  // The attempt and pass name the picture; the query that goes with it is part of the URL.
  const std::string etag = "\"" + std::to_string(job->attempt) + "-" +
                           (snapshot.light ? std::to_string(snapshot.pass) : "final") + "\"";
  if (client_has(request, etag)) return not_modified(etag);
  if (!part.previews.try_acquire_for(std::chrono::seconds(5)))
    return problem({"overloaded", "Too many previews are being made.", {}}, request);
  const Slot slot(part.previews);
  auto png = render_preview(part, request, *job, snapshot);
  if (!png) return problem(png.error(), request);
  http::Response response;
  response.content_type = "image/png";
  response.body = std::move(*png);
  return response.header("ETag", etag).header("Cache-Control", "no-cache");
}

}  // namespace kiln::api
