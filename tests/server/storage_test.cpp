#include <gtest/gtest.h>
#include <sys/resource.h>

#include <csignal>
#include <fstream>

#include "server/base/clock.h"
#include "server/base/ids.h"
#include "server/data/data_folder.h"
#include "server/data/scene_store.h"
#include "tests/support/temp_files.h"

namespace kiln::data {
namespace {

namespace fs = std::filesystem;

UploadedFile write_file(SceneUpload& upload, const std::string& name, const std::string& content) {
  auto file = proto::HashingFile::create(upload.next_path());
  EXPECT_TRUE(file && file->write(content));
  const std::string hash = file->finish().value();
  return {name, file->path(), content.size(), hash};
}

TEST(DataFolder, BelongsToOneServerAtATime) {
  const test::TempFolder folder;
  {
    auto first = DataFolder::open(folder.path() / "data");
    ASSERT_TRUE(first);
    EXPECT_TRUE(first->writable());
    EXPECT_GT(first->free_share(), 0);
    auto second = DataFolder::open(folder.path() / "data");
    ASSERT_FALSE(second);
    EXPECT_EQ(second.error().code, "data_folder_in_use");
    EXPECT_NE(second.error().message.find("data"), std::string::npos);
    std::ofstream(first->temporary() / "left_over") << "x";
  }
  auto third = DataFolder::open(folder.path() / "data");
  ASSERT_TRUE(third) << "the lock goes with its owner";
  EXPECT_TRUE(fs::is_empty(third->temporary()));
}

TEST(SceneStore, NamesScenesByContent) {
  const test::TempFolder folder;
  auto data = DataFolder::open(folder.path());
  const SceneStore store(*data);
  const auto put = [&](const std::string& main,
                       std::vector<std::pair<std::string, std::string>> side) {
    auto upload = SceneUpload::create(*data);
    upload->main = write_file(*upload, "", main);
    for (const auto& [name, content] : side)
      upload->side.push_back(write_file(*upload, name, content));
    return store.put(std::move(*upload)).value();
  };
  const auto alone = put("glTF...", {});
  EXPECT_TRUE(alone.created);
  EXPECT_EQ(alone.scene.key, alone.scene.main_sha256);
  EXPECT_FALSE(put("glTF...", {}).created);

  const auto bundle = put("{}", {{"b.png", "B"}, {"a.bin", "A"}});
  EXPECT_NE(bundle.scene.key, bundle.scene.main_sha256);
  EXPECT_EQ(bundle.scene.bytes, 4u);
  EXPECT_FALSE(put("{}", {{"a.bin", "A"}, {"b.png", "B"}}).created) << "order does not matter";
  EXPECT_TRUE(put("{}", {{"a.bin", "B"}, {"b.png", "A"}}).created) << "names matter";

  const auto found = store.find(bundle.scene.key).value();
  EXPECT_EQ(found.main_sha256, bundle.scene.main_sha256);
  EXPECT_EQ(proto::read_file(found.files.main, 10).value(), "{}");
  EXPECT_EQ(proto::read_file(found.files.side.at("a.bin"), 10).value(), "A");
  EXPECT_EQ(proto::read_file(found.files.side.at("b.png"), 10).value(), "B");
  EXPECT_TRUE(fs::is_empty(data->temporary()));
}

TEST(SceneStore, FindsNothingUnderOtherNames) {
  const test::TempFolder folder;
  auto data = DataFolder::open(folder.path());
  const SceneStore store(*data);
  for (const std::string& key : {std::string(64, '0'), std::string("../../etc"), std::string()})
    EXPECT_EQ(store.find(key).error().code, "not_found");
}

TEST(Ids, AreLongAndSortByAge) {
  std::string last;
  for (int i = 0; i < 1000; ++i) {
    const std::string id = base::new_id("job_");
    EXPECT_TRUE(base::is_id(id, "job_")) << id;
    EXPECT_LE(last.substr(0, 14), id.substr(0, 14));
    EXPECT_NE(last, id);
    last = id;
  }
  for (const char* bad :
       {"", "job_", "job_../../../etc/passwd.......", "scn_01234567890123456789012345",
        "job_0123456789012345678901234", "job_0123456789012345678901234A"})
    EXPECT_FALSE(base::is_id(bad, "job_")) << bad;
}

TEST(Clock, WritesTimesThatSort) {
  using std::chrono::seconds;
  const std::string now = base::now_rfc3339(), later = base::now_rfc3339(seconds(1));
  EXPECT_EQ(now.size(), std::string("2026-01-01T00:00:00.000Z").size());
  EXPECT_LT(now, later);
  EXPECT_TRUE(now.starts_with(base::today()) || base::now_rfc3339().starts_with(base::today()));
}

TEST(Clock, AddsSecondsToItsOwnTextsOnly) {
  using std::chrono::seconds;
  EXPECT_EQ(base::seconds_after("2024-02-28T23:59:59.042Z", seconds(1)),
            "2024-02-29T00:00:00.042Z");
  EXPECT_EQ(base::seconds_after("2026-12-31T23:59:59.999Z", seconds(86'400)),
            "2027-01-01T23:59:59.999Z");
  EXPECT_EQ(base::seconds_after("2026-03-01T00:00:00.000Z", seconds(-1)),
            "2026-02-28T23:59:59.000Z");
  for (const char* bad :
       {"", "now", "2026-01-01", "2026-01-01T00:00:00Z", "2026-01-01T00:00:00.000",
        "2026-01-01T00:00:00.0000Z", "2026-13-01T00:00:00.000Z", "2026-02-30T00:00:00.000Z",
        "2026-01-01T00:00:00.000+01:00", "2026-01-01T00:00:00.000Z "})
    EXPECT_EQ(base::seconds_after(bad, seconds(1)), "") << bad;
}

}  // namespace
}  // namespace kiln::data
