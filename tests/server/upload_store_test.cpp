#include "server/data/upload_store.h"

#include <gtest/gtest.h>

#include <optional>

#include "tests/support/temp_files.h"

namespace kiln::data {
namespace {

using namespace std::chrono_literals;

class Uploads : public testing::Test {
 protected:
  test::TempFolder folder_;
  std::optional<DataFolder> data_;
  std::optional<UploadStore> store_;

  void SetUp() override { restart(); }
  void restart() {
    store_.reset();
    data_.reset();
    data_.emplace(DataFolder::open(folder_.path() / "data").value());
    store_.emplace(*data_, 3600s);
  }
  static PartialUpload wanted(std::uint64_t length, const std::string& name = "",
                              const std::string& tenant = "art") {
    PartialUpload upload;
    upload.tenant = tenant;
    upload.name = name;
    upload.content_type = "model/gltf-binary";
    upload.length = length;
    return upload;
  }
  std::string open(std::uint64_t length, const std::string& name = "") {
    return store_->open(wanted(length, name))->upload.id;
  }
  std::uint64_t offset(const std::string& id) { return store_->look(id, "art", false)->offset; }
};

TEST_F(Uploads, GrowAndSurviveAProcess) {
  const std::string id = open(10);
  auto first = store_->append(id, 0);
  ASSERT_TRUE(first);
  ASSERT_TRUE(first->write("0123"));
  ASSERT_TRUE(first->write("45"));
  EXPECT_EQ(first->finish()->offset, 6u);
  restart();
  EXPECT_EQ(offset(id), 6u);
  auto rest = store_->append(id, 6);
  ASSERT_TRUE(rest->write("6789"));
  EXPECT_TRUE(rest->finish()->complete());
  EXPECT_EQ(test::read_bytes(store_->file(id)), "0123456789");
}

TEST_F(Uploads, ForgetWhatWasNotFlushed) {
  const std::string id = open(100);
  auto first = store_->append(id, 0);
  ASSERT_TRUE(first->write("0123"));
  ASSERT_TRUE(first->finish());
  ASSERT_TRUE(first->write("456"));  // and the process is killed
  restart();
  EXPECT_EQ(offset(id), 4u) << "only what is on the disk for sure";
  EXPECT_EQ(test::read_bytes(store_->file(id)), "0123");
}

TEST_F(Uploads, TakeNoBytesAtAnotherPlaceOrBeyondTheirLength) {
  const std::string id = open(4);
  EXPECT_EQ(store_->append(id, 1).error().code, "offset_mismatch");
  auto appender = store_->append(id, 0);
  EXPECT_EQ(appender->write("12345").error().code, "payload_too_large");
  EXPECT_TRUE(appender->write("1234"));
  EXPECT_EQ(appender->write("5").error().code, "payload_too_large");
  EXPECT_EQ(store_->append("upl_none", 0).error().code, "not_found");
}

TEST_F(Uploads, BelongToWhoeverCameLast) {
  const std::string id = open(100);
  auto slow = store_->append(id, 0);
  ASSERT_TRUE(slow->write("a"));
  EXPECT_EQ(offset(id), 1u);
  EXPECT_EQ(slow->write("b").error().code, "offset_mismatch") << "its offset was told to another";
  auto next = store_->append(id, 1);
  EXPECT_EQ(slow->write("b").error().code, "offset_mismatch");
  EXPECT_TRUE(next->write("c"));
  EXPECT_EQ(next->finish()->offset, 2u);
}

TEST_F(Uploads, AreFoundByTheirNameAgain) {
  const std::string id = open(10, "yard");
  EXPECT_FALSE(store_->open(wanted(10, "yard"))->created);
  EXPECT_EQ(open(10, "yard"), id);
  EXPECT_NE(open(10), open(10)) << "no name, no upload to find";
  EXPECT_EQ(store_->open(wanted(11, "yard")).error().code, "idempotency_mismatch");
  EXPECT_TRUE(store_->open(wanted(11, "yard", "game"))->created) << "another tenant's name";
  restart();
  EXPECT_EQ(open(10, "yard"), id);
}

TEST_F(Uploads, AreSeenByTheirTenantOnly) {
  const std::string id = open(10);
  EXPECT_EQ(store_->look(id, "game", false).error().code, "not_found");
  EXPECT_TRUE(store_->look(id, "ops", true));
  EXPECT_EQ(store_->bytes("art"), 10u);
  EXPECT_EQ(store_->bytes("game"), 0u);
}

TEST_F(Uploads, AreBoundedInNumber) {
  for (std::size_t i = 0; i < UploadStore::kMaxPerTenant; ++i) open(1);
  EXPECT_EQ(store_->open(wanted(1)).error().code, "quota_exceeded");
  EXPECT_TRUE(store_->open(wanted(1, "", "game")));
}

TEST_F(Uploads, LeaveNothingBehind) {
  const std::string done = open(4), old = open(4);
  auto appender = store_->append(done, 0);
  ASSERT_TRUE(appender->write("glTF"));
  ASSERT_TRUE(appender->finish());
  ASSERT_TRUE(store_->finished(done, std::string(64, 'a')));
  EXPECT_FALSE(std::filesystem::exists(store_->file(done)));
  EXPECT_EQ(store_->bytes("art"), 4u) << "of the other one";
  std::filesystem::create_directory(data_->uploads() / "upl_broken");
  restart();
  EXPECT_FALSE(std::filesystem::exists(data_->uploads() / "upl_broken"));
  EXPECT_EQ(store_->look(done, "art", false)->scene, std::string(64, 'a'));
  EXPECT_TRUE(store_->look(done, "art", false)->complete());
  store_->remove(old);
  EXPECT_FALSE(store_->look(old, "art", false));
  store_->sweep("2000-01-01T00:00:00.000Z");
  EXPECT_TRUE(store_->look(done, "art", false));
  store_->sweep("2999-01-01T00:00:00.000Z");
  EXPECT_FALSE(store_->look(done, "art", false));
  EXPECT_TRUE(std::filesystem::is_empty(data_->uploads()));
}

}  // namespace
}  // namespace kiln::data
