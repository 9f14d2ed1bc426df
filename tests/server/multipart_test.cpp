#include "server/http/multipart.h"

#include <gtest/gtest.h>

#include <vector>

namespace kiln::http {
namespace {

struct Part {
  PartHead head;
  std::string data;
  bool ended = false;
};

struct Parsed {
  proto::Expected<void> result;
  std::vector<Part> parts;
};

/// Feeds `body` in pieces of `piece` bytes.
Parsed parse(const std::string& body, std::size_t piece, const std::string& boundary = "B") {
  Parsed parsed;
  MultipartReader reader(boundary, {[&](const PartHead& head) {
                                      parsed.parts.push_back({head, {}, false});
                                      return proto::Expected<void>();
                                    },
                                    [&](std::string_view bytes) {
                                      parsed.parts.back().data += bytes;
                                      return proto::Expected<void>();
                                    },
                                    [&] {
                                      parsed.parts.back().ended = true;
                                      return proto::Expected<void>();
                                    }});
  for (std::size_t at = 0; at < body.size() && parsed.result; at += piece)
    parsed.result = reader.feed(std::string_view(body).substr(at, piece));
  if (parsed.result) parsed.result = reader.finish();
  return parsed;
}

std::string part(const std::string& disposition, const std::string& data) {
  return "--B\r\nContent-Disposition: form-data; " + disposition + "\r\n\r\n" + data + "\r\n";
}

TEST(Multipart, FindsPartsWhateverThePieces) {
  const std::string tricky = "a\r\n--x\r\n-\r\n--\r\n--b\r\n\0z" + std::string("\r\n--");
  const std::string body = part("name=\"scene\"; filename=\"a.glb\"", tricky) +
                           part("name=\"empty\"", "") + part("name=settings", "{}") + "--B--\r\n";
  for (std::size_t piece = 1; piece <= body.size(); ++piece) {
    const Parsed parsed = parse(body, piece);
    ASSERT_TRUE(parsed.result) << piece << ": " << parsed.result.error().message;
    ASSERT_EQ(parsed.parts.size(), 3u) << piece;
    EXPECT_EQ(parsed.parts[0].data, tricky) << piece;
    EXPECT_EQ(parsed.parts[0].head.filename, "a.glb");
    EXPECT_EQ(parsed.parts[1].data, "") << piece;
    EXPECT_FALSE(parsed.parts[1].head.filename);
    EXPECT_EQ(parsed.parts[2].head.name, "settings");
    EXPECT_EQ(parsed.parts[2].data, "{}");
    EXPECT_TRUE(parsed.parts[2].ended);
  }
}

TEST(Multipart, ReadsNamesAsClientsWriteThem) {
  const auto head = [](const std::string& line) { return parse_part_head(line).value(); };
  EXPECT_EQ(head("Content-Disposition: form-data; name=\"a\\\"b\"").name, "a\"b");
  EXPECT_EQ(*head("content-disposition:form-data;filename=x.png;name=f").filename, "x.png");
  EXPECT_EQ(*head("Content-Disposition: form-data; name=f; filename=\"x\"; "
                  "filename*=UTF-8''%e2%82%ac.png")
                 .filename,
            "\xe2\x82\xac.png");
  EXPECT_EQ(*head("Content-Disposition: form-data; name=f; filename=\"C:\\dir\\x\"").filename,
            "C:\\dir\\x");
  EXPECT_EQ(head("Content-Type: a/b\r\nContent-Disposition: form-data; name=f").content_type,
            "a/b");
}

TEST(Multipart, RefusesMalformedBodies) {
  const std::string good = part("name=\"a\"", "x");
  for (const std::string& body :
       {std::string(""), std::string("garbage"), std::string(20'000, 'x'), good, good + "--B",
        good + "--Bx", std::string("--B\r\nno colon\r\n\r\nx\r\n--B--\r\n"),
        std::string("--B\r\nContent-Type: a/b\r\n\r\nx\r\n--B--\r\n"),
        std::string("--B\r\nContent-Disposition: form-data\r\n\r\nx\r\n--B--\r\n"),
        std::string("--B\r\nContent-Disposition: form-data; name=\"a\r\n\r\nx\r\n--B--\r\n"),
        "--B\r\nA: " + std::string(9000, 'a') + "\r\n\r\nx\r\n--B--\r\n"}) {
    const Parsed parsed = parse(body, 7);
    ASSERT_FALSE(parsed.result) << body.substr(0, 80);
    EXPECT_EQ(parsed.result.error().code, "bad_request");
  }
  std::string many;
  for (int i = 0; i < 257; ++i) many += good;
  EXPECT_FALSE(parse(many + "--B--\r\n", 4096).result);
}

// One hostile 8 KiB part header costs the library's regular expression 0.4 s and 2 MiB of stack.
TEST(Multipart, TakesNoTimeOverHostileHeaders) {
  std::string names;
  while (names.size() < 8000) names += "\"; filename=\"";
  const std::string body = part("name=\"" + names + "x", "x") + "--B--\r\n";
  for (int i = 0; i < 200; ++i) EXPECT_FALSE(parse(body, 4096).result);
}

TEST(Multipart, FindsTheBoundary) {
  EXPECT_EQ(multipart_boundary("multipart/form-data; boundary=B; charset=utf-8"), "B");
  EXPECT_EQ(multipart_boundary("Multipart/Form-Data;charset=utf-8;boundary=\"a b\""), "a b");
  EXPECT_FALSE(multipart_boundary("multipart/form-data"));
  EXPECT_FALSE(multipart_boundary("multipart/form-data; boundary="));
  EXPECT_FALSE(multipart_boundary("multipart/mixed; boundary=B"));
  EXPECT_FALSE(multipart_boundary("multipart/form-data; boundary=" + std::string(71, 'a')));
}

}  // namespace
}  // namespace kiln::http
