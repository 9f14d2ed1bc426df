#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>
#include <vector>

#include "proto/bake_settings.h"
#include "proto/event.h"
#include "proto/expected.h"
#include "proto/job.h"
#include "proto/job_options.h"
#include "proto/manifest.h"

/// Reads and writes the service's own JSON documents, and is the only place that does. The baker's
/// folders read and write glTF.
namespace kiln::proto {

/// Parses untrusted text. It must have a nesting depth <= 64, no duplicate keys and valid UTF-8.
/// Errors: `invalid_json` (with line and column in the message).
Expected<nlohmann::json> parse_json(std::string_view text, std::string_view source);

/// Returns "line 3, column 14" for the byte at `byte` of a text; all three count as editors do.
std::string line_and_column(std::string_view text, std::size_t byte);

/// Returns the document as text, on one line when `indent` is negative. It never throws: bytes that
/// are not UTF-8 (in a client's file name, say) become U+FFFD.
std::string to_text(const nlohmann::json&, int indent = -1);

/// Reads settings and reports every problem at once, each with its pointer: an unknown key (with
/// the nearest known name), a wrong type, a value out of range, an impossible combination. Errors:
/// `invalid_settings`.
Expected<BakeSettings> settings_from_json(const nlohmann::json&);
/// Calls parse_json(), then settings_from_json(). Empty text means all defaults.
Expected<BakeSettings> parse_settings(std::string_view text);
/// Sets one value in a settings document by an assignment such as "solver.samples=64". The value is
/// JSON or a bare word. Errors: `invalid_settings`.
Expected<void> set_by_path(nlohmann::json& settings, std::string_view assignment);

/// Reads priority, labels, ttl_seconds, dedupe and webhook, and reports all problems at once.
/// Errors: `invalid_request`.
Expected<JobOptions> job_options_from_json(const nlohmann::json&);
/// Reads priority, labels and ttl_seconds of a change; null removes a label. Errors:
/// `invalid_request`.
Expected<JobPatch> job_patch_from_json(const nlohmann::json&);
/// Reads labels: {"name": "value"}. Errors: `invalid_request`.
Expected<Labels> labels_from_json(const nlohmann::json&);

nlohmann::json to_json(const JobOptions&);
nlohmann::json to_json(const BakeSettings&);  ///< every value, defaults included
nlohmann::json to_json(const Job&);           ///< with links
nlohmann::json to_json(const JobProgress&);
nlohmann::json to_json(const PassReport&);
nlohmann::json to_json(const Warning&);
nlohmann::json to_json(const Manifest&);

/// Returns an application/problem+json document (RFC 9457) without a request, as a failed job's
/// `error` holds it and the store keeps it. Title and status follow from the code (problems.h).
nlohmann::json to_json(const Error&);
/// Returns the same document as the answer to a request. `instance` is left out when empty.
nlohmann::json problem_json(const Error&, int http_status, std::string_view request_id,
                            std::string_view instance = {});

// These readers report members that are missing or of the wrong type as the error `bad_document`,
// with their pointers. They ignore unknown members, since the writer may be newer.
Expected<Error> error_from_json(const nlohmann::json&);
Expected<PassReport> pass_report_from_json(const nlohmann::json&);
Expected<JobProgress> progress_from_json(const nlohmann::json&);
Expected<JobSummary> job_summary_from_json(const nlohmann::json&);
Expected<std::vector<JobSummary>> job_list_from_json(const nlohmann::json&);  ///< {"items": [...]}
Expected<Manifest> manifest_from_json(const nlohmann::json&);
/// Reads only `files` of a manifest, whatever the version of the rest.
Expected<std::vector<ResultFile>> result_files_from_json(const nlohmann::json&);

const char* to_string(JobState);
Expected<JobState> job_state_from_string(std::string_view);

/// Returns the JSON Schema (2020-12) of the settings object: types, ranges, defaults, descriptions,
/// units.
nlohmann::json settings_schema();

}  // namespace kiln::proto
