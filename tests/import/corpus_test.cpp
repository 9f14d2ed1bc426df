// The real files beside this repository and what must happen to each of them.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <map>
#include <optional>
#include <sstream>
#include <string>
#include <vector>

#include "baker/import/import.h"

namespace kiln::import {
namespace {

namespace fs = std::filesystem;

struct Row {
  std::string file, must, reason;
  std::vector<std::string> attachments;
};

std::vector<std::string> split(const std::string& line, char separator) {
  std::vector<std::string> out;
  std::istringstream in(line);
  for (std::string field; std::getline(in, field, separator);) out.push_back(field);
  return out;
}

fs::path corpus() {
  return fs::path(LIGHTKILN_SHARED_DIR) / "corpus";
}

std::vector<Row> rows() {
  std::vector<Row> out;
  std::ifstream in(corpus() / "index.tsv");
  std::string line;
  std::getline(in, line);  // the head
  while (std::getline(in, line)) {
    const auto f = split(line, '\t');
    if (f.size() < 7) throw std::runtime_error("a row with too few columns: " + line);
    out.push_back({f[0], f[5], f[6], f[3] == "-" ? std::vector<std::string>{} : split(f[3], ' ')});
  }
  return out;
}

files::SceneFiles files_of(const Row& row) {
  files::SceneFiles files;
  files.main = corpus() / row.file;
  for (const std::string& name : row.attachments) {
    const auto path = files.main.parent_path() / name;
    if (fs::is_regular_file(path)) files.side[name] = path;
  }
  return files;
}

struct Outcome {
  std::optional<proto::Error> error;
  std::vector<proto::Warning> warnings;
};

/// What a service would do: check before it accepts, import when it runs the job.
Outcome bake_input(const Row& row) {
  proto::BakeSettings settings;
  settings.allow_dark = true;  // few of the files have a light
  const auto files = files_of(row);
  const auto checked = check_scene(files, settings);
  auto scene = import_scene(files, settings);
  // What the check refuses the import must refuse too, or bakes would depend on who asks.
  if (!checked) {
    EXPECT_FALSE(scene.has_value()) << row.file;
  }
  // What only decoding finds is all that the check may miss.
  if (checked && !scene) {
    EXPECT_EQ(scene.error().code, "invalid_image") << row.file;
  }
  if (!checked) return {checked.error(), {}};
  if (!scene) return {scene.error(), {}};
  EXPECT_FALSE(scene->triangles.empty()) << row.file;
  return {std::nullopt, scene->warnings};
}

std::string describe(const Outcome& outcome) {
  if (!outcome.error) return "baked";
  return outcome.error->code + " at " +
         (outcome.error->details.empty() ? "?" : outcome.error->details[0].pointer) + ": " +
         outcome.error->message;
}

/// Codes that fit the reason which the table gives for a refusal.
bool code_fits(const std::string& code, const std::string& reason) {
  if (reason.starts_with("unsupported_required_extension")) return code == "unsupported_extension";
  if (reason.starts_with("invalid_container")) return code == "invalid_scene";
  if (reason.starts_with("invalid_gltf:IO_ERROR"))
    return code == "missing_file" || code == "invalid_scene";
  if (reason.starts_with("invalid_gltf"))
    return code == "invalid_scene" || code == "nothing_to_bake";
  // A file without triangles may also be refused for another fault that it has.
  if (reason == "nothing_to_bake") return code == "nothing_to_bake" || code == "invalid_scene";
  if (reason.starts_with("invalid_image")) {
    return code == "invalid_image" || code == "nothing_to_bake" || code == "missing_file" ||
           code == "invalid_scene";
  }
  return true;
}

bool behaves(const Row& row, const Outcome& outcome) {
  const bool baked = !outcome.error;
  if (row.must == "bake") return baked;
  if (row.must == "reject") return !baked && code_fits(outcome.error->code, row.reason);
  if (row.must == "reject_or_warn") {
    return baked ? !outcome.warnings.empty() : code_fits(outcome.error->code, row.reason);
  }
  if (row.must == "bake_or_reject") return baked || outcome.error->code == "unsupported_extension";
  return row.must == "either";
}

TEST(Corpus, EveryFileBehavesAsTheTableSays) {
  if (!fs::exists(corpus() / "index.tsv")) {
    GTEST_SKIP() << "the corpus is absent: " << corpus().string();
  }
  std::map<std::string, int> seen;
  for (const Row& row : rows()) {
    SCOPED_TRACE(row.file);
    const Outcome outcome = bake_input(row);
    // Nothing is refused for want of a feature alone.
    if (row.must == "bake_or_reject") {
      EXPECT_FALSE(outcome.error) << describe(outcome);
    }
    EXPECT_TRUE(behaves(row, outcome))
        << "must " << row.must << " (" << row.reason << "), but: " << describe(outcome);
    ++seen[row.must];
  }
  EXPECT_GT(seen["bake"], 0);
  EXPECT_GT(seen["reject"], 0);
}

}  // namespace
}  // namespace kiln::import
