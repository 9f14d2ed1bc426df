#pragma once

#include <gtest/gtest.h>

#include <cstdint>
#include <filesystem>
#include <functional>
#include <mutex>
#include <stop_token>
#include <string>
#include <vector>

#include "baker/bake.h"
#include "baker/generate/generate.h"
#include "tests/support/temp_files.h"

namespace kiln::baker {

namespace fs = std::filesystem;
using test::read_bytes;
using test::TempFolder;

/// What a bake told.
struct Told {
  std::vector<std::string> stages;
  std::vector<proto::PassReport> passes;
  std::vector<std::string> checkpoint_warnings;  ///< their codes
  std::uint32_t snapshots = 0, resumed = 0;
  double within = 0;  ///< share of the pass that followed
};

/// Keeps what it is told of a bake, and stops it when asked to.
struct Recorder : BakeObserver, Told {
  std::mutex mutex;
  double fraction = 0;
  bool fell = false;
  std::vector<double> etas;
  std::stop_source stop;
  std::size_t stop_after = SIZE_MAX;  ///< passes
  std::function<void()> when_solving;

  void on_stage(const std::string& s) override {
    stages.push_back(s);
    if (s == "solve" && when_solving) when_solving();
  }
  void on_resume(std::uint32_t n) override { resumed = n; }
  void on_resume_within(const std::string&, double share) override { within = share; }
  void on_warning(const proto::Warning& w) override {
    const std::lock_guard lock(mutex);
    if (w.code.starts_with("checkpoint_")) checkpoint_warnings.push_back(w.code);
  }
  void on_pass(const proto::PassReport& p) override {
    passes.push_back(p);
    if (passes.size() == stop_after) stop.request_stop();
  }
  void on_snapshot(Snapshot s) override {
    ++snapshots;
    EXPECT_EQ(s.light->size(), s.texels->size());
  }
  void on_progress(const proto::JobProgress& p) override {
    const std::lock_guard lock(mutex);
    fell = fell || p.fraction < fraction - 0.02;  // two threads may report out of turn
    fraction = p.fraction;
    if (p.eta_seconds) etas.push_back(*p.eta_seconds);
  }
};

/// A bake of a generated scene in folders of the test's own.
inline BakeInput input_for(const TempFolder& folder, const std::string& generator,
                           std::uint32_t page_size) {
  const auto glb = generate::generate_glb(generator);
  EXPECT_TRUE(glb);
  BakeInput in;
  in.files.main = folder.write("scene.glb", *glb);
  in.settings.atlas.page_size = page_size;
  in.output_dir = folder.path() / "out";
  in.checkpoint_dir = folder.path() / "checkpoints";
  in.scene_sha256 = "cafe";
  in.scene_key = "beef";
  in.checkpoint_share = 1;
  fs::create_directories(in.output_dir);
  fs::create_directories(in.checkpoint_dir);
  return in;
}

}  // namespace kiln::baker
