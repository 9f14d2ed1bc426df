#include "baker/solver/checkpoint.h"

#include <openssl/evp.h>

#include <array>
#include <cstring>
#include <fstream>
#include <memory>
#include <new>
#include <type_traits>

#include "baker/output/files.h"

namespace kiln::baker {
namespace {

constexpr std::array<char, 8> kMagic{'K', 'I', 'L', 'N', 'P', 'A', 'S', '1'};
constexpr const char* kFileName = "pass.bin";
constexpr std::size_t kDigestBytes = 32;
constexpr std::uint32_t kMaxTextBytes = 4096;
using Digest = std::array<unsigned char, kDigestBytes>;

/// SHA-256 over what passes through.
class Hasher {
 public:
  Hasher() : context_(EVP_MD_CTX_new()) {
    if (!context_ || EVP_DigestInit_ex(context_.get(), EVP_sha256(), nullptr) != 1)
      throw std::bad_alloc();
  }
  void add(const void* data, std::size_t bytes) { EVP_DigestUpdate(context_.get(), data, bytes); }
  Digest finish() {
    Digest d;
    EVP_DigestFinal_ex(context_.get(), d.data(), nullptr);
    return d;
  }

 private:
  struct Free {
    void operator()(EVP_MD_CTX* c) const { EVP_MD_CTX_free(c); }
  };
  std::unique_ptr<EVP_MD_CTX, Free> context_;
};

class Writer {
 public:
  explicit Writer(std::ofstream& out) : out_(out) {}
  void bytes(const void* data, std::size_t n) {
    out_.write(static_cast<const char*>(data), std::streamsize(n));
    hash_.add(data, n);
  }
  template <class T>
  void value(T v) {
    static_assert(std::is_arithmetic_v<T>);
    bytes(&v, sizeof v);
  }
  void text(const std::string& s) {
    value(std::uint32_t(s.size()));
    bytes(s.data(), s.size());
  }
  template <class T>
  void plane(const std::vector<T>& p) {
    bytes(p.data(), p.size() * sizeof(T));
  }
  void seal() {
    const Digest d = hash_.finish();
    out_.write(reinterpret_cast<const char*>(d.data()), kDigestBytes);
  }

 private:
  std::ofstream& out_;
  Hasher hash_;
};

class Reader {
 public:
  explicit Reader(std::ifstream& in) : in_(in) {}
  bool bytes(void* data, std::size_t n) {
    if (!in_.read(static_cast<char*>(data), std::streamsize(n))) return false;
    hash_.add(data, n);
    return true;
  }
  template <class T>
  bool value(T& v) {
    return bytes(&v, sizeof v);
  }
  bool text(std::string& s) {
    std::uint32_t n = 0;
    if (!value(n) || n > kMaxTextBytes) return false;
    s.resize(n);
    return bytes(s.data(), n);
  }
  template <class T>
  bool plane(std::vector<T>& p) {
    return bytes(p.data(), p.size() * sizeof(T));
  }
  bool sealed() {
    const Digest expected = hash_.finish();
    Digest found;
    in_.read(reinterpret_cast<char*>(found.data()), kDigestBytes);
    return in_ && found == expected;
  }

 private:
  std::ifstream& in_;
  Hasher hash_;
};

void write_report(Writer& w, const proto::PassReport& p) {
  w.text(p.name);
  w.value(p.index);
  w.value(p.residual);
  w.value(p.mean_lx);
  w.value(p.seconds);
  w.value(p.rays);
}

bool read_report(Reader& r, proto::PassReport& p) {
  return r.text(p.name) && r.value(p.index) && r.value(p.residual) && r.value(p.mean_lx) &&
         r.value(p.seconds) && r.value(p.rays);
}

bool read_all(Reader& r, std::uint64_t file_bytes, Checkpoint& c) {
  std::array<char, kMagic.size()> magic;
  std::uint32_t passes = 0, texels = 0;
  if (!r.bytes(magic.data(), magic.size()) || magic != kMagic) return false;
  if (!r.text(c.key) || !r.value(passes) || passes > file_bytes) return false;
  for (std::uint32_t i = 0; i < passes; ++i)
    if (!read_report(r, c.passes.emplace_back())) return false;
  constexpr std::uint64_t kTexelBytes = 3 * sizeof(Rgb) + sizeof(float);
  if (!r.value(texels) || texels * kTexelBytes > file_bytes) return false;
  c.light = Lightmap(texels);
  return r.plane(c.light.direct) && r.plane(c.light.sky) && r.plane(c.light.indirect) &&
         r.plane(c.light.validity) && r.sealed();
}

}  // namespace

proto::Expected<void> write_checkpoint(const std::filesystem::path& dir, const std::string& key,
                                       std::span<const proto::PassReport> passes,
                                       const Lightmap& light) {
  return write_whole(dir / kFileName, [&](const std::filesystem::path& temporary) {
    std::ofstream out(temporary, std::ios::binary);
    Writer w(out);
    w.bytes(kMagic.data(), kMagic.size());
    w.text(key);
    w.value(std::uint32_t(passes.size()));
    for (const auto& p : passes) write_report(w, p);
    w.value(light.size());
    w.plane(light.direct);
    w.plane(light.sky);
    w.plane(light.indirect);
    w.plane(light.validity);
    w.seal();
    out.close();
    if (!out)
      return proto::Expected<void>(
          proto::fail("io_error", "Can't write the checkpoint " + temporary.string() + "."));
    return proto::Expected<void>();
  });
}

proto::Expected<Checkpoint> read_checkpoint(const std::filesystem::path& dir,
                                            const std::string& key) {
  const std::filesystem::path file = dir / kFileName;
  std::error_code missing;
  const auto size = std::filesystem::file_size(file, missing);
  if (missing)
    return proto::fail("no_checkpoint", "There is no checkpoint in " + dir.string() + ".");
  std::ifstream in(file, std::ios::binary);
  Reader reader(in);
  Checkpoint c;
  if (!in || !read_all(reader, size, c))
    return proto::fail("no_checkpoint", "The checkpoint " + file.string() + " is damaged.");
  if (c.key != key)
    return proto::fail("no_checkpoint", "The checkpoint " + file.string() + " is of another bake.");
  return c;
}

}  // namespace kiln::baker
