#include "server/http/content.h"

#include <fcntl.h>
#include <gtest/gtest.h>

#include "server/api/zip.h"
#include "tests/support/temp_files.h"

namespace kiln::http {
namespace {

std::shared_ptr<const proto::Fd> open_file(const std::filesystem::path& path) {
  return std::make_shared<const proto::Fd>(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
}

std::string read_all(const Content& content, std::size_t step) {
  std::string text, piece(step, 0);
  while (text.size() < length_of(content)) {
    const auto got = read_content(content, text.size(), piece.data(), step);
    if (got <= 0) break;
    text.append(piece, 0, static_cast<std::size_t>(got));
  }
  return text;
}

TEST(Content, IsReadAndCutAcrossItsParts) {
  const test::TempFolder folder;
  const auto file = open_file(folder.write("f", "45678"));
  const Content content{ContentPart::of("0123"), ContentPart::of(""), ContentPart::of(file, 5),
                        ContentPart::of("9")};
  const std::string whole = "0123456789";
  EXPECT_EQ(length_of(content), 10u);
  for (std::size_t step : {1u, 3u, 100u}) EXPECT_EQ(read_all(content, step), whole);
  for (std::size_t from = 0; from <= 10; ++from)
    for (std::size_t n = 0; from + n <= 10; ++n) {
      const Content cut = slice(content, from, n);
      EXPECT_EQ(read_all(cut, 2), whole.substr(from, n));
      EXPECT_EQ(read_all(slice(cut, 0, n / 2), 7), whole.substr(from, n / 2));
    }
  char byte = 0;
  EXPECT_EQ(read_content(content, 10, &byte, 1), 0);
  EXPECT_LE(read_content({ContentPart::of(file, 9)}, 6, &byte, 1), 0) << "shorter than it was";
}

TEST(Zip, IsWhatOtherProgramsRead) {
  const test::TempFolder folder;
  std::vector<api::ZipEntry> entries;
  for (const std::string& text : {std::string("first"), std::string(), std::string(100'000, 'x')}) {
    const std::string name = "f" + std::to_string(text.size()) + ".bin";
    entries.push_back({name, open_file(folder.write(name, text)), text.size()});
  }
  const Content archive = zip_of(entries).value();
  const std::string bytes = read_all(archive, 4096);
  EXPECT_EQ(bytes, read_all(zip_of(entries).value(), 10)) << "the same each time";
  folder.write("all.zip", bytes);
  const std::string program =
      "cd " + folder.path().string() +
      " && python3 -c \"import zipfile; z = zipfile.ZipFile('all.zip'); assert not z.testzip();"
      " assert z.namelist() == ['f5.bin', 'f0.bin', 'f100000.bin'];"
      " assert all(z.read(n) == open(n, 'rb').read() for n in z.namelist())\"";
  EXPECT_EQ(std::system(program.c_str()), 0);
}

// The archive's head and tail around files that no disk here holds: sparse ones.
TEST(Zip, KnowsFilesBeyondFourGigabytes) {
  const test::TempFolder folder;
  const auto path = folder.write("big.bin", "");
  constexpr std::uint64_t kBytes = (4ull << 30) + 7;
  std::filesystem::resize_file(path, kBytes);
  const auto small = folder.write("small.bin", "end");
  const Content archive =
      api::zip_of({{"big.bin", open_file(path), kBytes}, {"small.bin", open_file(small), 3}}).value();
  const Content head{archive.at(0)};
  const std::uint64_t tail = length_of(head) + kBytes;
  // Only the file's bytes are left out: a hole of the same length takes their place.
  const auto zip = folder.write("all.zip", read_all(head, 4096));
  std::filesystem::resize_file(zip, tail);
  std::ofstream out(zip, std::ios::binary | std::ios::app);
  out << read_all(slice(archive, tail, length_of(archive) - tail), 4096);
  out.close();
  const std::string program = "python3 -c \"import zipfile; z = zipfile.ZipFile('" + zip.string() +
                              "');"
                              " assert z.getinfo('big.bin').file_size == " +
                              std::to_string(kBytes) +
                              ";"
                              " assert z.read('small.bin') == b'end'\"";
  EXPECT_EQ(std::system(program.c_str()), 0);
}

}  // namespace
}  // namespace kiln::http
