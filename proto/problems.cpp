#include "proto/problems.h"

#include <algorithm>

namespace kiln::proto {

const std::vector<ProblemKind>& problem_kinds() {
  static const std::vector<ProblemKind> kinds{
      {"atlas_full", 422, "The scene needs more lightmap pages than allowed"},
      {"bad_document", 502, "A document of the service can't be read"},
      {"bad_request", 400, "The request can't be understood"},
      {"bake_timeout", 500, "The job took longer than the service allows"},
      {"canceled", 409, "The job was canceled"},
      {"digest_mismatch", 422, "The content does not have the digest that was announced"},
      {"draining", 503, "The service is shutting down"},
      {"forbidden_origin", 403, "Web pages of other sites may not use the service"},
      {"forbidden_scope", 403, "The token does not allow this"},
      {"headers_too_large", 431, "The request's headers are too large"},
      {"idempotency_in_progress", 409, "A request with this Idempotency-Key is being answered"},
      {"idempotency_mismatch", 422, "The Idempotency-Key was used for another request"},
      {"import_crashed", 500, "The scene could not be read: its reader broke down"},
      {"import_out_of_memory", 422, "Reading the scene takes more memory than the service allows"},
      {"import_timeout", 422, "Reading the scene takes longer than the service allows"},
      {"internal", 500, "Something went wrong inside the service"},
      {"invalid_image", 422, "An image can't be read"},
      {"invalid_json", 400, "The JSON can't be read"},
      {"invalid_lightmap_uv", 422, "The scene's lightmap coordinates can't be used"},
      {"invalid_request", 422, "The request has a part that does not belong"},
      {"invalid_scene", 422, "The scene is not valid glTF"},
      {"invalid_settings", 422, "The settings are not valid"},
      {"io_error", 500, "A file can't be read or written"},
      {"job_failed", 500, "The job failed"},
      {"job_not_retryable", 409, "The job can't be run again"},
      {"job_not_terminal", 409, "The job has not ended yet"},
      {"job_too_large", 422, "The job needs more memory than the service may use"},
      {"length_required", 411, "The request needs a Content-Length"},
      {"limit_exceeded", 422, "The scene is larger than the service allows"},
      {"method_not_allowed", 405, "The resource does not know this method"},
      {"missing_file", 422, "A file that the scene names was not sent"},
      {"no_light", 422, "The scene has no light"},
      {"not_acceptable", 406, "No representation fits what the client accepts"},
      {"not_found", 404, "There is nothing here"},
      {"nothing_to_bake", 422, "The scene has no surface to bake"},
      {"offset_mismatch", 409, "The upload goes on at another byte"},
      {"out_of_memory", 500, "The job needed more memory than there is"},
      {"overloaded", 503, "The service has too much to do"},
      {"payload_too_large", 413, "The request's body is too large"},
      {"precondition_failed", 412, "A condition of the request does not hold"},
      {"queue_full", 503, "The queue is full"},
      {"quota_exceeded", 429, "The tenant has used up its share"},
      {"range_not_satisfiable", 416, "The range lies outside the file"},
      {"rate_limited", 429, "Too many requests"},
      {"request_timeout", 408, "The request took too long to arrive"},
      {"result_not_ready", 425, "The result is not there yet"},
      {"storage_full", 507, "The service's storage is full"},
      {"too_expensive", 422, "The method would take too long for the scene"},
      {"too_many_connections", 503, "Too many connections of one address"},
      {"too_many_uploads", 429, "Too many uploads at a time"},
      {"unauthorized", 401, "A valid token is needed"},
      {"unknown_generator", 422, "There is no generated scene of this name"},
      {"unsupported_extension", 422, "The scene requires an extension that is not supported"},
      {"unsupported_media_type", 415, "The media type is not supported"},
      {"uri_too_long", 414, "The request's path or query is too long"},
      {"worker_lost", 500, "The service ended while it ran the job"},
  };
  return kinds;
}

const ProblemKind& problem_kind(std::string_view code) {
  const auto find = [](std::string_view wanted) {
    const auto& kinds = problem_kinds();
    return std::find_if(kinds.begin(), kinds.end(),
                        [&](const ProblemKind& k) { return k.code == wanted; });
  };
  const auto at = find(code);
  return at != problem_kinds().end() ? *at : *find("internal");
}

}  // namespace kiln::proto
