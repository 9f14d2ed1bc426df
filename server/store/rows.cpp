#include "server/store/rows.h"

#include <nlohmann/json.hpp>

#include "proto/json.h"

namespace kiln::store {
namespace {

void read_settings(const std::string& text, proto::Job& job) {
  auto settings = proto::parse_settings(text);
  if (settings) {
    job.settings = std::move(*settings);
  } else if (!job.error) {
    job.error = proto::Error{"internal", "The stored settings of this job can't be read.",
                             settings.error().details};
  }
}

void read_error(const std::string& text, proto::Job& job) {
  if (text.empty()) return;
  auto document = proto::parse_json(text, "store");
  auto error = document ? proto::error_from_json(*document) : tl::make_unexpected(document.error());
  job.error = error ? *error : error.error();
}

void read_labels(const std::string& text, proto::Job& job) {
  auto document = proto::parse_json(text, "store");
  auto labels =
      document ? proto::labels_from_json(*document) : tl::make_unexpected(document.error());
  if (labels) job.labels = std::move(*labels);
}

void read_webhook_text(const std::string& text, proto::Job& job) {
  if (text.empty()) return;
  auto document = proto::parse_json(text, "store");
  auto hook =
      document ? proto::webhook_from_json(*document) : tl::make_unexpected(document.error());
  if (hook) job.webhook = std::move(*hook);
}

}  // namespace

StoredJob read_job_row(const Statement& row) {
  StoredJob stored;
  proto::Job& job = stored.job;
  stored.sequence = row.number(0);
  job.id = row.text(1);
  job.state = proto::job_state_from_string(row.text(2)).value();
  job.priority = static_cast<std::int32_t>(row.number(3));
  job.attempt = static_cast<std::uint32_t>(row.number(4));
  stored.crashes = static_cast<std::uint32_t>(row.number(5));
  job.version = static_cast<std::uint64_t>(row.number(6));
  job.scene_sha256 = row.text(7);
  job.scene_bytes = static_cast<std::uint64_t>(row.number(8));
  job.created_at = row.text(10);
  job.started_at = row.text(11);
  job.finished_at = row.text(12);
  job.progress.stage = row.text(13);
  job.progress.pass = static_cast<std::uint32_t>(row.number(14));
  job.progress.max_passes = static_cast<std::uint32_t>(row.number(15));
  job.progress.batches_done = static_cast<std::uint32_t>(row.number(16));
  job.progress.batches_total = static_cast<std::uint32_t>(row.number(17));
  job.progress.residual = row.real(18);
  job.progress.fraction = row.real(19);
  read_error(row.text(20), job);
  read_settings(row.text(9), job);
  stored.bake_key = job.result_key = row.text(21);
  read_labels(row.text(22), job);
  job.ttl_seconds = static_cast<std::uint64_t>(row.number(23));
  job.expires_at = row.text(24);
  job.cached = row.number(25) != 0;
  job.tenant = row.text(26);
  read_webhook_text(row.text(27), job);
  job.memory_estimate_bytes = static_cast<std::uint64_t>(row.number(28));
  return stored;
}

std::vector<StoredJob> read_job_rows(Statement& rows) {
  std::vector<StoredJob> jobs;
  while (rows.step()) jobs.push_back(read_job_row(rows));
  return jobs;
}

}  // namespace kiln::store
