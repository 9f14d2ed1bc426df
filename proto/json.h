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

/// JSON in and out. The only place where the service's own documents are read or written; glTF is
/// the scene and output folders' affair.
namespace kiln::proto {

/// Parses untrusted text: nesting depth <= 64, no duplicate keys, valid UTF-8.
/// Errors: `invalid_json` (with line and column in the message).
Expected<nlohmann::json> parse_json(std::string_view text, std::string_view source);

/// "line 3, column 14" of the byte at `byte` of a text; all three count as editors do.
std::string line_and_column(std::string_view text, std::size_t byte);

/// The document as text, on one line when `indent` is negative. Never throws: what is not UTF-8 (a
/// client's file name, say) is replaced by U+FFFD.
std::string to_text(const nlohmann::json&, int indent = -1);

/// Every problem is reported at once, each with its pointer: unknown key (with the nearest known
/// name), wrong type, out of range, combination that can't be. Errors: `invalid_settings`.
Expected<BakeSettings> settings_from_json(const nlohmann::json&);
/// parse_json, then settings_from_json. Empty text means all defaults.
Expected<BakeSettings> parse_settings(std::string_view text);
/// "solver.samples=64": sets one value in a settings document. Value: JSON, or a bare word.
Expected<void> set_by_path(nlohmann::json& settings, std::string_view assignment);

/// Priority, labels, ttl_seconds, dedupe: all problems at once. Errors: `invalid_request`.
Expected<JobOptions> job_options_from_json(const nlohmann::json&);
/// The same without dedupe; a label that is null goes. Errors: `invalid_request`.
Expected<JobPatch> job_patch_from_json(const nlohmann::json&);
/// {"name": "value"}. Errors: `invalid_request`.
Expected<Labels> labels_from_json(const nlohmann::json&);

nlohmann::json to_json(const JobOptions&);
nlohmann::json to_json(const BakeSettings&);  ///< every value, defaults included
nlohmann::json to_json(const Job&);           ///< with links
nlohmann::json to_json(const JobProgress&);
nlohmann::json to_json(const PassReport&);
nlohmann::json to_json(const Warning&);
nlohmann::json to_json(const Manifest&);

/// An application/problem+json document (RFC 9457) without a request: what a failed job's `error`
/// holds, and how the store keeps it. Title and status follow from the code (problems.h).
nlohmann::json to_json(const Error&);
/// The same as the answer to a request. `instance` is left out when empty.
nlohmann::json problem_json(const Error&, int http_status, std::string_view request_id,
                            std::string_view instance = {});

// Readers: members that are missing or of the wrong type are the error `bad_document`, with their
// pointers. Unknown members are ignored, for the writer may be newer.
Expected<Error> error_from_json(const nlohmann::json&);
Expected<PassReport> pass_report_from_json(const nlohmann::json&);
Expected<JobProgress> progress_from_json(const nlohmann::json&);
Expected<JobSummary> job_summary_from_json(const nlohmann::json&);
Expected<std::vector<JobSummary>> job_list_from_json(const nlohmann::json&);  ///< {"items": [...]}
Expected<Manifest> manifest_from_json(const nlohmann::json&);
/// Only `files` of a manifest, whatever the version of the rest.
Expected<std::vector<ResultFile>> result_files_from_json(const nlohmann::json&);

const char* to_string(JobState);
Expected<JobState> job_state_from_string(std::string_view);

/// JSON Schema (2020-12) of the settings object: types, ranges, defaults, descriptions, units.
nlohmann::json settings_schema();

}  // namespace kiln::proto
