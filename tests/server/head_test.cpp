#include "server/http/head.h"

#include <gtest/gtest.h>

namespace kiln::http {
namespace {

std::string get(const std::string& target, const std::string& headers = "Host: x\r\n") {
  return "GET " + target + " HTTP/1.1\r\n" + headers + "\r\n";
}

std::string code_of(const std::string& bytes) {
  auto head = parse_head(bytes);
  return head ? "" : head.error().code;
}

TEST(Head, ReadsPathQueryAndHeaders) {
  auto head = parse_head(get("/v1/a%20b?x=1&y=a%26b+c&z", "Host: x\r\nETag-ish:  \"a%2Fb\" \r\n"));
  ASSERT_TRUE(head) << head.error().message;
  EXPECT_EQ(head->path, "/v1/a b");
  EXPECT_EQ(*head->query_value("x"), "1");
  EXPECT_EQ(*head->query_value("y"), "a&b c");
  EXPECT_EQ(*head->query_value("z"), "");
  EXPECT_EQ(*head->header("etag-ISH"), "\"a%2Fb\"") << "header values are raw";
  EXPECT_FALSE(head->has_body());
}

TEST(Head, RefusesWhatTwoReadersCouldReadDifferently) {
  const std::string post = "POST / HTTP/1.1\r\nHost: x\r\n";
  for (const std::string& bytes : {
           post + "Content-Length: 3\r\nContent-Length: 4\r\n\r\n",
           post + "Content-Length: 3\r\nContent-Length: 3\r\n\r\n",
           post + "Content-Length: 3\r\nTransfer-Encoding: chunked\r\n\r\n",
           post + "Transfer-Encoding: gzip, chunked\r\n\r\n",
           post + "Transfer-Encoding: chunked\r\nTransfer-Encoding: chunked\r\n\r\n",
           post + "Content-Length: +3\r\n\r\n",
           post + "Content-Length: %33\r\n\r\n",
           post + "Content-Length: 0x3\r\n\r\n",
           post + "Content-Length: 3, 3\r\n\r\n",
           post + "Content-Length: 99999999999999999999\r\n\r\n",
           post + "Content-Length : 3\r\n\r\n",
           post + "A: b\nContent-Length: 3\r\n\r\n",
           post + "A: b\r\n folded\r\n\r\n",
           std::string("POST / HTTP/1.0\r\nTransfer-Encoding: chunked\r\n\r\n"),
           get("/", "Host: x\r\nContent-Length: 3\r\n"),
           get("/", "Host: x\r\nTransfer-Encoding: chunked\r\n"),
           get("/", "Host: x\r\nHost: y\r\n"),
           get("/", ""),
           get("/a\tb"),
           get("/a%0ab"),
           get("/a%zz"),
           get("/a%4"),
           get("a"),
           std::string("GET / HTTP/2.0\r\nHost: x\r\n\r\n"),
           std::string("GET /\r\n\r\n"),
           std::string("GET / HTTP/1.1\nHost: x\n\n"),
           get("/", std::string("Host: x\r\nA: b\0c\r\n", 17)),
       })
    EXPECT_EQ(code_of(bytes), "bad_request") << bytes;
}

TEST(Head, BoundsPathTargetAndHeaderCount) {
  EXPECT_EQ(code_of(get("/" + std::string(511, 'a'))), "");
  EXPECT_EQ(code_of(get("/" + std::string(512, 'a'))), "uri_too_long");
  EXPECT_EQ(code_of(get("/?" + std::string(5000, 'a'))), "uri_too_long");
  std::string headers = "Host: x\r\n";
  for (int i = 0; i < 99; ++i) headers += "A: b\r\n";
  EXPECT_EQ(code_of(get("/", headers)), "");
  EXPECT_EQ(code_of(get("/", headers + "A: b\r\n")), "headers_too_large");
  EXPECT_EQ(code_of("BREW / HTTP/1.1\r\nHost: x\r\n\r\n"), "method_not_allowed");
}

TEST(Head, KnowsWhenTheClientWantsToClose) {
  EXPECT_FALSE(parse_head(get("/"))->wants_close());
  EXPECT_TRUE(parse_head(get("/", "Host: x\r\nConnection: Close\r\n"))->wants_close());
  EXPECT_TRUE(parse_head("GET / HTTP/1.0\r\n\r\n")->wants_close());
  EXPECT_FALSE(parse_head("GET / HTTP/1.0\r\nConnection: keep-alive\r\n\r\n")->wants_close());
}

}  // namespace
}  // namespace kiln::http
