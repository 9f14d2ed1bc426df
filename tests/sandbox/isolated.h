#pragma once

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <atomic>
#include <chrono>
#include <filesystem>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "baker/bake.h"
#include "server/sandbox/importer.h"
#include "tests/sandbox/slow_scene.h"
#include "tests/support/sanitizer.h"
#include "tests/support/temp_files.h"

namespace kiln::test {

namespace fs = std::filesystem;
using namespace std::chrono_literals;

inline constexpr bool kHasMemoryLimit = kSlowdown == 1;  // sanitizers have none

struct Scene {
  TempFolder folder;
  files::SceneFiles files;
  explicit Scene(const std::string& glb) { files.main = folder.write("scene.glb", glb); }
};

/// An importer with the built program, that counts and remembers its processes.
struct Isolated {
  TempFolder folder;
  std::atomic<pid_t> pid{0};
  std::atomic<int> started{0};
  std::string failed, said;
  sandbox::Importer::Options options;

  Isolated() {
    static const auto zygote = std::make_shared<sandbox::Zygote>(
        sandbox::Zygote::Options{LIGHTKILN_BINARY, [](const std::string&) {}});
    options.process.program = LIGHTKILN_BINARY;
    options.process.zygote = zygote;
    options.process.seconds = 60;
    options.process.started = [this](pid_t now) {
      ++started;
      pid = now;
    };
    options.process.failed = [this](const std::string& reason, const std::string& words) {
      failed = reason;
      said = words;
    };
    options.new_temporary = [this] { return folder.path() / ("t" + std::to_string(started)); };
    fs::create_directories(cache());
  }
  fs::path cache() const { return folder.path() / "cache"; }
  std::vector<fs::path> cached() const {
    std::vector<fs::path> files;
    for (const auto& entry : fs::directory_iterator(cache())) files.push_back(entry.path());
    return files;
  }
  proto::Expected<scene::Scene> import(const files::SceneFiles& files, std::stop_token stop = {}) {
    return sandbox::Importer(options).open(files, "key", cache())->import(std::move(stop));
  }
  std::string code_of(const files::SceneFiles& files) {
    const auto scene = import(files);
    return scene ? "" : scene.error().code;
  }
  /// The process once it is confined and decodes.
  pid_t confined_pid() const {
    for (int i = 0; i < 20'000; ++i, std::this_thread::sleep_for(1ms))
      if (const pid_t now = pid; now > 0 && is_confined(now)) return now;
    return -1;
  }
};

/// A program in place of the importer: a shell script, whose descriptor 3 is the product.
inline fs::path script(const TempFolder& folder, const std::string& lines) {
  const fs::path path = folder.write("impostor", "#!/bin/sh\n" + lines + "\n");
  ::chmod(path.c_str(), 0700);
  return path;
}

/// A small bake with the whole pipeline; the folder of its results, or the error.
inline proto::Expected<proto::Manifest> bake_small(const files::SceneFiles& files,
                                                   const TempFolder& out,
                                                   std::shared_ptr<baker::UploadReader> source = {},
                                                   std::optional<std::string> sky_map = {},
                                                   const proto::OutputSettings& output = {}) {
  baker::BakeInput input;
  input.settings.output = output;
  input.files = files;
  input.output_dir = out.path();
  input.source = std::move(source);
  input.settings.sky.map = std::move(sky_map);
  input.settings.atlas.page_size = 64;
  input.settings.solver.samples = 16;
  exec::ThreadPool pool(2);
  baker::BakeObserver quiet;
  return baker::bake(input, pool, {}, quiet);
}

}  // namespace kiln::test
