#include "server/jobs/job_log.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "tests/server/job_service_fixture.h"
#include "tests/support/temp_files.h"

namespace kiln::jobs {
namespace {

std::size_t lines_in(const std::string& text) {
  return static_cast<std::size_t>(std::count(text.begin(), text.end(), '\n'));
}

TEST(JobLog, IsALinePerStepThatNobodyCanForge) {
  const test::TempFolder folder;
  const auto path = folder.path() / "log.txt";
  JobLog(path).line("stage solve");
  JobLog(path).line("warning: a\nb\r\x1b[2Jc\td");
  const std::string text = test::read_bytes(path);
  EXPECT_EQ(lines_in(text), 2u);
  EXPECT_NE(text.find("Z stage solve\n"), std::string::npos);
  EXPECT_NE(text.find("warning: a b  [2Jc d\n"), std::string::npos);
  JobLog("/no/such/folder/log.txt").line("is left out");
}

TEST(JobLog, HasABound) {
  const test::TempFolder folder;
  const auto path = folder.path() / "log.txt";
  const JobLog log(path);
  for (int i = 0; i < 40; ++i) log.line(std::string(50'000, 'x'));
  const std::string text = test::read_bytes(path);
  EXPECT_EQ(text.size(), JobLog::kMaxBytes);
  EXPECT_NE(text.find("\n... and more, which is left out"), std::string::npos);
  EXPECT_EQ(text.back(), '\n');
}

TEST_F(JobServiceTest, KeepsALogOverAttempts) {
  int runs = 0;
  const BakeFunction fails_once =
      [&, good = fake_.instant(2)](
          const JobInput& input, exec::ThreadPool& pool, std::stop_token stop,
          baker::BakeObserver& observer) -> proto::Expected<proto::Manifest> {
    if (++runs == 1) return proto::fail("no_light", "Dark.");
    return good(input, pool, stop, observer);
  };
  start(fails_once);
  const std::string id = submit();
  EXPECT_EQ(wait(id).state, JobState::kFailed);
  ASSERT_TRUE(control().retry(id, RetryFrom::kStart));
  EXPECT_EQ(wait(id).state, JobState::kSucceeded);
  const std::string log = test::read_bytes(process_->data.results(id) / "log.txt");
  for (const char* part : {"attempt 1 of job ", "state failed: no_light: Dark.\n", "attempt 2 of ",
                           "pass 1 bounce: {", "stage output\n", "done: "})
    EXPECT_NE(log.find(part), std::string::npos) << part << log;
}

}  // namespace
}  // namespace kiln::jobs
