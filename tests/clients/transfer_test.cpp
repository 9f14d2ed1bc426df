#include <gtest/gtest.h>

#include "clients/multipart_body.h"
#include "clients/server_url.h"
#include "clients/verified_file.h"
#include "tests/support/temp_files.h"

namespace kiln::clients {
namespace {

// SHA-256 of "abc": FIPS 180-4's own example.
constexpr const char* kAbc = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";

std::string read_all(MultipartBody& body, std::uint64_t step) {
  std::string out;
  while (out.size() < body.size()) {
    const auto before = out.size();
    EXPECT_TRUE(body.read(out.size(), step, [&](std::string_view piece) {
      out += piece;
      return true;
    })) << body.error();
    if (out.size() == before) break;
  }
  return out;
}

TEST(MultipartBody, BytesAreTheSameInStepsOfEverySize) {
  const test::TempFolder dir;
  MultipartBody body("B");
  body.add_text("settings", "application/json", "{}");
  ASSERT_TRUE(body.add_file("scene", "a\"\r\nb.glb", dir.write("a", "12345")));
  ASSERT_TRUE(body.add_file("file", "empty", dir.write("e", "")));
  body.finish();
  const std::string expected =
      "--B\r\nContent-Disposition: form-data; name=\"settings\"\r\n"
      "Content-Type: application/json\r\n\r\n{}\r\n"
      "--B\r\nContent-Disposition: form-data; name=\"scene\"; filename=\"a%22%0D%0Ab.glb\"\r\n"
      "Content-Type: application/octet-stream\r\n\r\n12345\r\n"
      "--B\r\nContent-Disposition: form-data; name=\"file\"; filename=\"empty\"\r\n"
      "Content-Type: application/octet-stream\r\n\r\n\r\n"
      "--B--\r\n";
  EXPECT_EQ(body.size(), expected.size());
  for (const std::uint64_t step : {1u, 2u, 3u, 7u, 64u, 1000u, 1u << 20})
    EXPECT_EQ(read_all(body, step), expected) << step;
}

TEST(MultipartBody, LargeFilesComeInBoundedPieces) {
  const test::TempFolder dir;
  const std::string bytes(1'000'000, 'x');
  MultipartBody body("B");
  ASSERT_TRUE(body.add_file("scene", "a", dir.write("a", bytes)));
  body.finish();
  std::size_t largest = 0, total = 0;
  while (total < body.size())
    ASSERT_TRUE(body.read(total, body.size() - total, [&](std::string_view piece) {
      largest = std::max(largest, piece.size());
      total += piece.size();
      return true;
    }));
  EXPECT_LE(largest, 256u << 10);
}

TEST(MultipartBody, AFileThatShrinksIsNoticed) {
  const test::TempFolder dir;
  MultipartBody body("B");
  const auto file = dir.write("a", std::string(1000, 'x'));
  ASSERT_TRUE(body.add_file("scene", "a", file));
  body.finish();
  dir.write("a", "short");
  bool fine = true;
  for (std::uint64_t at = 0; at < body.size() && fine;)
    fine = body.read(at, body.size(), [&](std::string_view piece) {
      at += piece.size();
      return true;
    });
  EXPECT_FALSE(fine);
  EXPECT_NE(body.error().find("changed"), std::string::npos);
}

TEST(MultipartBody, MissingFilesAndFolders) {
  const test::TempFolder dir;
  MultipartBody body("B");
  EXPECT_EQ(body.add_file("scene", "a", dir.path() / "none").error().code, "missing_file");
  EXPECT_EQ(body.add_file("scene", "a", dir.path()).error().code, "missing_file");
}

TEST(VerifiedFile, AppearsOnlyWhole) {
  const test::TempFolder dir;
  const auto target = dir.path() / "page_00.exr";
  {
    VerifiedFile file(target);
    ASSERT_TRUE(file.open());
    file.write("half");
    ASSERT_TRUE(file.open());  // A second try starts empty.
    file.write("abc");
    EXPECT_FALSE(std::filesystem::exists(target));
    ASSERT_TRUE(file.commit(kAbc));
  }
  EXPECT_EQ(test::read_bytes(target), "abc");
  {
    VerifiedFile file(target);
    ASSERT_TRUE(file.open());
    file.write("abd");
    EXPECT_EQ(file.commit(kAbc).error().code, "digest_mismatch");
  }
  EXPECT_EQ(test::read_bytes(target), "abc");  // The old one is still there, nothing else is.
  const std::filesystem::directory_iterator entries(dir.path());
  EXPECT_EQ(std::distance(begin(entries), end(entries)), 1);
}

TEST(VerifiedFile, SaysWhenItCannotWrite) {
  const test::TempFolder dir;
  VerifiedFile file(dir.path() / "none" / "x");
  EXPECT_EQ(file.open().error().code, "io_error");
}

TEST(PlainNames, NothingThatLeavesItsFolder) {
  EXPECT_TRUE(is_plain_name("page_00.preview.png"));
  for (const char* name :
       {"", ".", "..", "../x", "/x", "a/b", "a\\b", ".hidden", "a b", "a\n", "ü"})
    EXPECT_FALSE(is_plain_name(name)) << name;
  EXPECT_FALSE(is_plain_name(std::string(129, 'a')));
}

TEST(ServerUrl, Forms) {
  EXPECT_EQ(parse_server_url("http://127.0.0.1:8080")->text(), "http://127.0.0.1:8080");
  EXPECT_EQ(parse_server_url("bake.example:81/")->text(), "http://bake.example:81");
  EXPECT_EQ(parse_server_url("https://x/kiln/")->base, "/kiln");
  EXPECT_EQ(parse_server_url("http://[::1]:8080/a")->origin, "http://[::1]:8080");
  for (const char* url :
       {"", "http://", "ftp://x", "http://:80", "http://x:0", "http://x:70000", "http://x:8a",
        "http://x/?q", "http://x/a b", "http://a b", "http://x:", "http://user@x"})
    EXPECT_FALSE(parse_server_url(url)) << url;
}

}  // namespace
}  // namespace kiln::clients
