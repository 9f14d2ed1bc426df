// A decoder of sky maps that lacks memory says so, and takes no sound file for a broken one: an
// import that lacked memory is tried again with more.
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdlib>
#include <fstream>
#include <new>

#include "baker/image/image.h"
#include "support/sky_files.h"

namespace kiln::image {
namespace {

/// Address space of this process, bytes.
rlim_t address_space() {
  std::ifstream file("/proc/self/statm");
  rlim_t pages = 0;
  file >> pages;
  return pages * rlim_t(::sysconf(_SC_PAGESIZE));
}

enum Outcome { kDecoded, kTooLittleMemory, kCalledBroken, kElse };

Outcome decode(const std::string& bytes, std::vector<math::Rgb>& texels) {
  try {
    auto header = read_header(bytes);
    return header && decode_rgb(*header, texels, {}, {}) ? kDecoded : kCalledBroken;
  } catch (const std::bad_alloc&) {
    return kTooLittleMemory;
  } catch (...) {
    return kElse;
  }
}

/// Takes all that the heap holds free.
void empty_heap() {
  for (std::size_t block = std::size_t(1) << 20; block >= 16; block /= 2)
    while (void* const taken = std::malloc(block)) *static_cast<void* volatile*>(taken) = taken;
}

/// In a process that may take only so much more memory than it has.
Outcome decode_within(rlim_t more, const std::string& bytes, std::vector<math::Rgb>& texels) {
  const pid_t child = ::fork();
  if (child == 0) {
    const rlim_t now = address_space();
    const rlimit none{now, RLIM_INFINITY}, some{now + more, RLIM_INFINITY};
    if (::setrlimit(RLIMIT_AS, &none) != 0) ::_exit(kElse);
    empty_heap();
    // As the import process does: not every part of the library lets std::bad_alloc fly.
    std::set_new_handler([] { ::_exit(kTooLittleMemory); });
    ::_exit(::setrlimit(RLIMIT_AS, &some) == 0 ? decode(bytes, texels) : kElse);
  }
  int status = 0;
  if (child < 0 || ::waitpid(child, &status, 0) != child || !WIFEXITED(status)) return kElse;
  return Outcome(WEXITSTATUS(status));
}

TEST(SkyMapMemory, TooLittleIsNoBrokenFile) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  GTEST_SKIP() << "sanitizers need more address space than any limit leaves";
#endif
  const test::SkyPicture sky(128, [](math::Vec3 d) {
    return math::Rgb{d.x * d.x, d.y * d.y, 1 + d.z};
  });
  std::vector<math::Rgb> texels(sky.pixels.size());
  ASSERT_TRUE(open_module());  // which takes memory, too
  for (const bool tiled : {false, true})
    for (const int compression : {0, 1, 3, 4, 5, 6, 9}) {
      const std::string bytes = exr_file(sky, {false, tiled, compression});
      int lacked = 0;
      Outcome outcome = kElse;
      for (rlim_t more = 0; more < (16u << 20) && outcome != kDecoded;
           more += (64u << 10) + more / 8) {
        outcome = decode_within(more, bytes, texels);
        EXPECT_TRUE(outcome == kDecoded || outcome == kTooLittleMemory)
            << "compression " << compression << (tiled ? ", tiled" : "") << ", " << more
            << " bytes: " << outcome;
        lacked += outcome == kTooLittleMemory;
      }
      EXPECT_EQ(outcome, kDecoded) << compression;
      EXPECT_GT(lacked, 0) << compression;
    }
}

}  // namespace
}  // namespace kiln::image
