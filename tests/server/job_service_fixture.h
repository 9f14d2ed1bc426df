#pragma once

#include <gtest/gtest.h>

#include <future>
#include <optional>

#include "server/jobs/job_service.h"
#include "tests/server/fake_bake.h"
#include "tests/support/temp_files.h"

namespace kiln::jobs {

using namespace std::chrono_literals;
using proto::JobState;

/// A queue on a folder of its own, which can be torn down and started again on the same data.
class JobServiceTest : public ::testing::Test {
 protected:
  struct Process {
    data::DataFolder data;
    store::JobStore store;
    data::SceneStore scenes;
    exec::ThreadPool pool{1};
    JobService jobs;
    Process(const std::filesystem::path& path, const BakeFunction& bake, JobLimits limits)
        : data(data::DataFolder::open(path).value()),
          store(data.database()),
          scenes(data),
          jobs({data, scenes, pool, bake, {}}, store, std::move(limits)) {}
  };

  void start(const BakeFunction& bake, JobLimits limits = {}) {
    process_.reset();
    process_.emplace(folder_.path(), bake, limits);
  }
  JobService& jobs() { return process_->jobs; }
  const JobLookup& lookup() { return jobs().lookup(); }
  JobSubmitter& submitter() { return jobs().submitter(); }
  JobControl& control() { return jobs().control(); }
  const Admission& admission() { return jobs().admission(); }

  data::StoredScene scene() {
    auto upload = data::SceneUpload::create(process_->data);
    auto file = proto::HashingFile::create(upload->next_path());
    EXPECT_TRUE(file->write("glTF"));
    const std::string hash = file->finish().value();
    upload->main = data::UploadedFile{"", file->path(), 4, hash};
    return process_->scenes.put(std::move(*upload))->scene;
  }
  /// A job that is baked, whatever was baked before.
  Submission submission() {
    Submission s{scene(), {}, {}, {}, {}};
    s.options.dedupe = false;
    return s;
  }
  std::string submit() { return submitter().submit(submission()).value().job.id; }
  /// The job when it is over, and its runner has let go of it.
  proto::Job wait(const std::string& id) {
    auto over = std::make_shared<std::promise<void>>();
    const auto watch = lookup().watch(id, std::nullopt, [over] { over->set_value(); });
    EXPECT_EQ(over->get_future().wait_for(20s), std::future_status::ready);
    // No change, but it is refused only when nobody runs the job any more.
    control().patch(id, {}, [](std::uint64_t) { return false; });
    return lookup().get(id).value();
  }
  /// Waits until the job is in `state`.
  void reach(const std::string& id, JobState state) {
    for (int i = 0; i < 2000; ++i) {
      if (lookup().get(id)->state == state) return;
      std::this_thread::sleep_for(5ms);
    }
    FAIL() << "the job did not get there";
  }
  std::vector<proto::Event> events(const std::string& id) {
    return lookup().events(id)->after(0).events;
  }
  static void expect_no_holes(const std::vector<proto::Event>& events) {
    for (std::size_t i = 0; i < events.size(); ++i) EXPECT_EQ(events[i].id, i + 1);
  }

  test::TempFolder folder_;
  FakeBake fake_;
  std::optional<Process> process_;
};

}  // namespace kiln::jobs
