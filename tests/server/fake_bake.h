#pragma once

#include <atomic>
#include <chrono>
#include <functional>
#include <thread>

#include "proto/files.h"
#include "server/jobs/job_service.h"

namespace kiln::jobs {

/// Stand-ins for baker::bake that need no scene and hold still until told.
class FakeBake {
 public:
  std::atomic<int> started{0};
  std::atomic<int> imported{0};
  std::atomic<bool> go{false};  ///< lets bakes that hold end well

  /// Writes page_00.exr (which is none) and manifest.json after `passes` passes.
  BakeFunction instant(int passes = 3) {
    return [this, passes](const JobInput& input, exec::ThreadPool&, std::stop_token,
                          baker::BakeObserver& observer) {
      ++started;
      return finish(input, observer, passes);
    };
  }
  /// Holds in the stage `solve` until go, enough or stop, reporting progress all the time.
  BakeFunction holding() {
    return [this](const JobInput& input, exec::ThreadPool&, std::stop_token stop,
                  baker::BakeObserver& observer) -> proto::Expected<proto::Manifest> {
      ++started;
      observer.on_stage("import");
      observer.on_stage("solve");
      proto::JobProgress progress{"solve", 0, 16, 0, 1000, 1, 0};
      while (!go && !input.finish_early.stop_requested()) {
        if (stop.stop_requested()) return proto::fail(proto::kCanceledCode, "Stopped.");
        ++progress.batches_done;
        observer.on_progress(progress);
        std::this_thread::sleep_for(std::chrono::milliseconds(5));
      }
      return finish(input, observer, 1);
    };
  }
  /// As holding(), for a bake that says it needs as many bytes as its seed.
  BakeFunction sized() {
    return [this, hold = holding()](
               const JobInput& input, exec::ThreadPool& pool, std::stop_token stop,
               baker::BakeObserver& observer) -> proto::Expected<proto::Manifest> {
      ++imported;
      if (auto ok = input.reserve_memory(input.settings.solver.seed, stop); !ok)
        return proto::Unexpected(ok.error());
      return hold(input, pool, stop, observer);
    };
  }
  static BakeFunction throwing(const std::function<void()>& raise) {
    return [raise](const JobInput&, exec::ThreadPool&, std::stop_token,
                   baker::BakeObserver&) -> proto::Expected<proto::Manifest> {
      raise();
      return proto::fail("internal", "not reached");
    };
  }

 private:
  static proto::Expected<proto::Manifest> finish(const JobInput& input,
                                                 baker::BakeObserver& observer, int passes) {
    for (int i = 0; i < passes; ++i) {
      proto::PassReport report;
      report.name = "bounce";
      report.index = static_cast<std::uint32_t>(i);
      observer.on_pass(report);
    }
    observer.on_stage("output");
    const std::string page(100'000, 'p');
    if (auto ok = proto::write_bytes(input.output_dir / "page_00.exr", page); !ok)
      return proto::Unexpected(ok.error());
    if (auto ok = proto::write_bytes(input.output_dir / "manifest.json", "{}"); !ok)
      return proto::Unexpected(ok.error());
    const auto digest = proto::digest_file(input.output_dir / "page_00.exr").value();
    proto::Manifest manifest;
    manifest.files.push_back({"page_00.exr", "image/x-exr", digest.bytes, digest.sha256});
    return manifest;
  }
};

}  // namespace kiln::jobs
