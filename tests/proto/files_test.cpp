#include "proto/files.h"

#include <fcntl.h>
#include <gtest/gtest.h>

#include <fstream>

#include "tests/support/temp_files.h"

namespace kiln::proto {
namespace {

namespace fs = std::filesystem;

// FIPS 180-4's own example, "abc".
constexpr const char* kAbc = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";

TEST(Sha256, KnownDigests) {
  Sha256 hash;
  hash.update("a");
  hash.update("bc");
  EXPECT_EQ(hash.hex(), kAbc);
  EXPECT_EQ(sha256_hex("abc"), kAbc);
  EXPECT_EQ(sha256_hex(""), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
  EXPECT_TRUE(is_sha256(kAbc));
  std::string upper = kAbc;
  upper[0] = 'B';
  for (const std::string& text : {std::string(), std::string(63, 'a'), std::string(65, 'a'), upper})
    EXPECT_FALSE(is_sha256(text)) << text;
}

TEST(HashingFile, HashesWhatItWrites) {
  const test::TempFolder folder;
  auto file = HashingFile::create(folder.path() / "f");
  ASSERT_TRUE(file->write("a"));
  ASSERT_TRUE(file->write("bc"));
  EXPECT_EQ(file->bytes(), 3u);
  EXPECT_EQ(file->finish().value(), kAbc);
  EXPECT_EQ(test::read_bytes(folder.path() / "f"), "abc");
}

TEST(HashingFile, AnAbandonedFileLeavesNothing) {
  const test::TempFolder folder;
  { ASSERT_TRUE(HashingFile::create(folder.path() / "f")->write("abc")); }
  EXPECT_TRUE(fs::is_empty(folder.path()));
}

TEST(HashingFile, TakesNoFileThatIsThere) {
  const test::TempFolder folder;
  folder.write("f", "abc");
  EXPECT_EQ(HashingFile::create(folder.path() / "f").error().code, "io_error");
  EXPECT_EQ(test::read_bytes(folder.path() / "f"), "abc");
}

TEST(Files, AFullDiskHasACodeOfItsOwn) {
  const Fd full(::open("/dev/full", O_WRONLY | O_CLOEXEC));
  ASSERT_TRUE(full.valid());
  ASSERT_LT(::write(full.get(), "x", 1), 0);
  EXPECT_EQ(storage_error("write", "f").value().code, "storage_full");
}

TEST(Files, ReplacesTheWholeContent) {
  const test::TempFolder folder;
  ASSERT_TRUE(write_bytes(folder.path() / "f", "first"));
  folder.write(".f.part", "left by a crash, longer than what comes");
  ASSERT_TRUE(write_bytes(folder.path() / "f", "2"));
  EXPECT_EQ(read_file(folder.path() / "f", 100).value(), "2");
  EXPECT_EQ(std::distance(fs::directory_iterator(folder.path()), {}), 1);
}

TEST(Files, AFailedWriteLeavesNothing) {
  const test::TempFolder folder;
  const auto ok = write_whole(folder.path() / "a.bin", [](const fs::path& temporary) {
    std::ofstream(temporary) << "half";
    return Expected<void>(fail("io_error", "disk full"));
  });
  ASSERT_FALSE(ok);
  EXPECT_EQ(ok.error().message, "disk full");
  EXPECT_TRUE(fs::is_empty(folder.path()));
}

TEST(Files, AFailedRenameLeavesNothing) {
  const test::TempFolder folder;
  folder.write("taken/inside", "x");  // a folder that is not empty can't be replaced
  EXPECT_EQ(write_bytes(folder.path() / "taken", "abc").error().code, "io_error");
  EXPECT_EQ(std::distance(fs::directory_iterator(folder.path()), {}), 1);
}

TEST(Files, DigestAndBoundedRead) {
  const test::TempFolder folder;
  const auto file = folder.write("f", "abc");
  EXPECT_EQ(digest_file(file)->sha256, kAbc);
  EXPECT_EQ(digest_file(file)->bytes, 3u);
  EXPECT_EQ(read_file(file, 3).value(), "abc");
  EXPECT_EQ(read_file(file, 2).error().code, "limit_exceeded");
  EXPECT_EQ(digest_file(folder.path() / "none").error().code, "io_error");
  EXPECT_EQ(read_file(folder.path() / "none", 1).error().code, "io_error");
}

}  // namespace
}  // namespace kiln::proto
