#include <gtest/gtest.h>

#include <atomic>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <thread>

#include "tests/http/program.h"
#include "tests/support/sanitizer.h"

/// Uploads by size: what the service takes in and what it takes to hold it.
namespace kiln::test {
namespace {

// A .glb whose binary chunk is blown up with zeros that nothing uses; the file is sparse.
std::filesystem::path write_large_scene(const std::filesystem::path& folder, std::uint64_t bytes) {
  auto path = write_small_scene(folder);
  std::fstream file(path, std::ios::in | std::ios::out | std::ios::binary);
  const auto word = [&](std::uint64_t at) {
    std::uint32_t value = 0;
    file.seekg(static_cast<std::streamoff>(at));
    file.read(reinterpret_cast<char*>(&value), sizeof value);
    return value;
  };
  const auto set_word = [&](std::uint64_t at, std::uint64_t value) {
    const auto narrow = static_cast<std::uint32_t>(value);
    file.seekp(static_cast<std::streamoff>(at));
    file.write(reinterpret_cast<const char*>(&narrow), sizeof narrow);
  };
  const std::uint64_t binary = 20 + word(12);  // header, JSON chunk's head and content
  // The chunk may hold more than its buffer by three bytes only: the buffer grows with it.
  std::string json(word(12), ' ');
  file.seekg(20);
  file.read(json.data(), static_cast<std::streamsize>(json.size()));
  const std::string key = "\"byteLength\":", old = std::to_string(word(binary));
  const std::string grown = std::to_string(bytes);
  const auto at = json.find("\"buffers\":[{" + key + old);
  EXPECT_NE(at, std::string::npos) << json;
  json.replace(json.find(old, at), old.size(), grown);
  std::string content(word(binary), '\0');
  file.seekg(static_cast<std::streamoff>(binary + 8));
  file.read(content.data(), static_cast<std::streamsize>(content.size()));
  while (json.size() % 4 != 0) json += ' ';
  set_word(8, 28 + json.size() + bytes);
  set_word(12, json.size());
  file.seekp(20);
  file << json;
  set_word(20 + json.size(), bytes);
  file << "BIN" << '\0' << content;
  file.close();
  std::filesystem::resize_file(path, 28 + json.size() + bytes);
  return path;
}

/// The highest anonymous memory of a program while this object lives.
class MemoryWatch {
 public:
  explicit MemoryWatch(const Program& program)
      : thread_([this, &program](std::stop_token stop) {
          while (!stop.stop_requested()) {
            const auto now = program.anonymous_bytes();
            if (now > peak) peak = now;
            std::this_thread::sleep_for(std::chrono::milliseconds(5));
          }
        }) {}
  std::atomic<std::uint64_t> peak{0};

 private:
  std::jthread thread_;
};

TEST(Uploads, HalfAGigabyteTakesNoMemory) {
  // AddressSanitizer keeps 256 MiB of what was freed. Either bound is less than the upload.
  constexpr std::uint64_t kBytes = 500'000'000, kAllowed = (kSlowdown > 1 ? 400ull : 64ull) << 20;
  const TempFolder folder;
  Program program(folder.path() / "data");
  const auto scene = write_large_scene(folder.path(), kBytes);
  ask(program.port(), "GET", "/v1/jobs");  // what the first request takes is not the upload's
  const std::uint64_t before = program.anonymous_bytes();
  ASSERT_GT(before, 0u);
  MemoryWatch watch(program);
  const Answer raw = curl("-H 'Content-Type: model/gltf-binary' -T " + scene.string() +
                          " -X POST " + program.url("/v1/scenes"));
  EXPECT_EQ(raw.status, 201) << raw.body;
  EXPECT_EQ(member(raw.body, "bytes"), std::to_string(std::filesystem::file_size(scene)));
  EXPECT_LT(watch.peak, before + kAllowed);
  // Chunked, as a multipart form, of content that is known.
  const Answer form = curl("-H 'Transfer-Encoding: chunked' -F scene=@" + scene.string() + " " +
                           program.url("/v1/scenes"));
  EXPECT_EQ(form.status, 200) << form.body;
  EXPECT_LT(watch.peak, before + kAllowed);
}

TEST(Uploads, WhatIsTooLargeIsRefusedBeforeItIsSent) {
  const TempFolder folder;
  Program program(folder.path() / "data", {"--max-upload-bytes", "1MiB"});
  const auto scene = write_large_scene(folder.path(), 100'000'000);
  const std::string known = "-F scene=@" + scene.string() + " " + program.url("/v1/jobs");
  const Answer refused = curl(known);
  EXPECT_EQ(refused.status, 413) << refused.body;
  EXPECT_EQ(member(refused.body, "code"), "payload_too_large");
  // Without a Content-Length it is noticed on the way.
  const Wire wire(program.port());
  wire.send("POST /v1/scenes HTTP/1.1\r\nHost: x\r\nTransfer-Encoding: chunked\r\n\r\n");
  const std::string chunk = "40000\r\n" + std::string(0x40000, 'x') + "\r\n";
  for (int i = 0; i < 5; ++i) wire.send(chunk);
  EXPECT_TRUE(wire.read("payload_too_large").starts_with("HTTP/1.1 413"));
  EXPECT_TRUE(std::filesystem::is_empty(folder.path() / "data" / "tmp"));
}

}  // namespace
}  // namespace kiln::test
