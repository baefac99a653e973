// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/http_request.h"

#include <gtest/gtest.h>

namespace throwcal {
namespace {

using Segments = std::vector<std::string>;

TEST(HttpRequest, APathIsItsDecodedSegments) {
  EXPECT_EQ(path_segments("/"), Segments{});
  EXPECT_EQ(path_segments("/api/v1/status"), (Segments{"api", "v1", "status"}));
  EXPECT_EQ(path_segments("/a?b=/c/../d"), (Segments{"a"}));
  EXPECT_EQ(path_segments("/?x"), Segments{});
  EXPECT_EQ(path_segments("/s%74atus/%c3%A9"), (Segments{"status", "\xc3\xa9"}));
  EXPECT_EQ(path_segments("/.."), (Segments{".."}));  // a name like any other: there are no files
}

TEST(HttpRequest, WhatIsNoPathIsRefused) {
  for (const char* bad : {"", "*", "status", "http://box/status", "//", "/a/", "/a//b", "/a%2fb",
                          "/a%25b", "/a%00", "/a%0a", "/a%7F", "/a%", "/a%4", "/a%4g", "/a%-1"})
    EXPECT_FALSE(path_segments(bad)) << bad;
}

TEST(HttpRequest, ATokenIsShownAsBearer) {
  EXPECT_EQ(bearer_token("Bearer abc"), "abc");
  EXPECT_EQ(bearer_token(" bEARER \t abc "), "abc");
  EXPECT_EQ(bearer_token("Bearer a b"), "a b");  // no token has a blank: it is refused as unknown
  for (const char* bad : {"", "abc", "Bearer", "Bearer ", "Basic abc", "Bearerabc"})
    EXPECT_FALSE(bearer_token(bad)) << bad;
}

TEST(HttpRequest, ATagIsFoundInAList) {
  const std::string tag = "\"abc\"";
  for (const char* list :
       {"\"abc\"", "*", " * ", "W/\"abc\"", "\"x\", \"abc\"", "\"x\",W/\"abc\" ,"})
    EXPECT_TRUE(names_tag(list, tag)) << list;
  for (const char* list : {"", ",", "abc", "\"ab\"", "\"abcd\"", "W/", "\"*\"", "\"x\" \"abc\""})
    EXPECT_FALSE(names_tag(list, tag)) << list;
}

TEST(HttpRequest, APageIsOursWhereItCameFromHere) {
  EXPECT_TRUE(is_own_page("http://Box.local:8080", "box.local:8080"));
  EXPECT_TRUE(is_own_page("https://box", "box"));  // behind a proxy that speaks TLS
  for (const char* origin : {"null", "", "http://evil", "http://box.evil", "box", "http://box:81"})
    EXPECT_FALSE(is_own_page(origin, "box")) << origin;
}

}  // namespace
}  // namespace throwcal
