#include <algorithm>
#include <utility>

#include "clients/client_impl.h"
#include "clients/verified_file.h"
#include "proto/files.h"
#include "proto/json.h"

namespace kiln::clients {
namespace {

constexpr int kTries = 3;
constexpr const char* kManifest = "manifest.json";

/// Returns the digest that a strong ETag holds, or "" when it holds none.
std::string digest_of(const std::string& etag) {
  const bool quoted = etag.size() == 66 && etag.front() == '"' && etag.back() == '"';
  const std::string inner = quoted ? etag.substr(1, 64) : etag;
  return proto::is_sha256(inner) ? inner : "";
}

bool is_there(const proto::ResultFile& file, const std::filesystem::path& target) {
  std::error_code error;
  if (file.sha256.empty() || !std::filesystem::is_regular_file(target, error)) return false;
  const auto digest = proto::digest_file(target);
  return digest && digest->sha256 == file.sha256;
}

}  // namespace

proto::Expected<std::vector<proto::ResultFile>> Client::results(const std::string& id) {
  if (auto ok = check_job_id(id); !ok) return proto::Unexpected(std::move(ok.error()));
  auto files = impl_->get("/jobs/" + id + "/results").and_then(proto::result_files_from_json);
  if (!files) return files;
  // A manifest can't hold its own digest, so its list may omit it.
  const bool listed = std::any_of(files->begin(), files->end(),
                                  [](const proto::ResultFile& f) { return f.name == kManifest; });
  if (!listed) files->push_back({kManifest, "application/json", 0, ""});
  for (const auto& file : *files)
    if (!is_plain_name(file.name))
      return proto::fail("bad_document", "The service lists a result named \"" +
                                             file.name.substr(0, 60) +
                                             "\", which is not a plain file name.");
  return files;
}

proto::Expected<void> Client::download(const std::string& id, const proto::ResultFile& file,
                                       const std::filesystem::path& dir) {
  if (auto ok = check_job_id(id); !ok) return ok;
  if (!is_plain_name(file.name))
    return proto::fail("bad_request", "\"" + file.name + "\" is not a plain file name");
  if (is_there(file, dir / file.name)) return {};
  VerifiedFile out(dir / file.name);
  proto::Error last;
  for (int i = 0; i < kTries; ++i) {
    if (auto ok = out.open(); !ok) return ok;
    int status = 0;
    std::string etag, problem;
    const auto answer = impl_->http.Get(
        impl_->path("/jobs/" + id + "/results/" + file.name),
        [&](const httplib::Response& head) {
          status = head.status;
          etag = head.get_header_value("ETag");
          return true;
        },
        [&](const char* data, std::size_t size) {
          if (status == 200) return out.write({data, size});
          problem.append(data, size);
          return problem.size() <= kMaxProblemBytes;
        });
    if (answer && status == 200)
      return out.commit(file.sha256.empty() ? digest_of(etag) : file.sha256);
    if (status == 200 && answer.error() == httplib::Error::Canceled)
      return out.commit(file.sha256);  // the write to disk failed; commit() returns its error
    if (answer) return proto::Unexpected(error_of_answer(status, problem, impl_->url.text()));
    last = impl_->unreachable(answer.error()).value();
  }
  return proto::Unexpected(std::move(last));
}

}  // namespace kiln::clients
