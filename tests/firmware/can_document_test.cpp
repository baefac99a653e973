// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/can_document.h"

#include <gtest/gtest.h>

#include "firmware/crc32.h"

namespace throwcal {
namespace {

using Outcome = CanDocumentReader::Outcome;

CanDocument document(std::size_t length, int sequence = 3) {
  CanDocument out{sequence, "", 0};
  for (std::size_t i = 0; i < length; ++i) out.text += static_cast<char>('!' + i * i % 90);
  out.crc32 = crc32(out.text);
  return out;
}

TEST(Crc32, IsThatOfTheCatalogue) { EXPECT_EQ(crc32("123456789"), 0xCBF43926u); }

TEST(CanDocument, ComesInBlocksOfAtMost4000Bytes) {
  for (const std::size_t length : {1u, 3983u, 3984u, 3985u, 7968u, 50000u}) {
    const CanDocument sent = document(length);
    EXPECT_EQ(sent.blocks(), static_cast<int>((length + 3983) / 3984));
    CanDocumentReader reader;
    for (int i = 0; i < sent.blocks(); ++i) {
      EXPECT_FALSE(reader.is_complete());
      EXPECT_EQ(reader.wanted(), i);
      EXPECT_LE(sent.block(i).size(), 4000u);
      EXPECT_EQ(reader.add(sent.block(i)), Outcome::taken);
    }
    EXPECT_TRUE(reader.is_complete());
    EXPECT_EQ(reader.text(), sent.text);
  }
  EXPECT_EQ(CanDocument{}.blocks(), 0);
}

TEST(CanDocument, HasTheHeaderThatTheDatabaseTells) {
  const CanDocument sent = document(4000, 9);
  const std::string block = sent.block(1);
  const std::string header{'\1', '\x09', '\1', '\0', '\2', '\0', '\0', '\0', '\xA0', '\x0F', 0, 0};
  EXPECT_EQ(block.substr(0, 12), header);
  EXPECT_EQ(block.size(), 16u + 16u);
}

TEST(CanDocument, IsNeverMixedOfTwo) {
  const CanDocument old = document(9000, 3), newer = document(9000, 4), longer = document(9001, 3);
  for (const CanDocument* other : {&newer, &longer}) {
    CanDocumentReader reader;
    EXPECT_EQ(reader.add(old.block(0)), Outcome::taken);
    EXPECT_EQ(reader.add(other->block(1)), Outcome::other_document);
    EXPECT_EQ(reader.wanted(), 0);
    for (int i = 0; i < 3; ++i) EXPECT_EQ(reader.add(other->block(i)), Outcome::taken);
    EXPECT_EQ(reader.text(), other->text);
  }
}

TEST(CanDocument, IgnoresWhatIsNotWanted) {
  const CanDocument sent = document(9000);
  CanDocumentReader reader;
  EXPECT_EQ(reader.add(""), Outcome::ignored);
  EXPECT_EQ(reader.add(sent.block(2)), Outcome::ignored);
  EXPECT_EQ(reader.add(sent.block(0)), Outcome::taken);
  EXPECT_EQ(reader.add(sent.block(0)), Outcome::ignored);
  EXPECT_EQ(reader.add(sent.block(1).substr(0, 3000)), Outcome::ignored);
  EXPECT_EQ(reader.add(sent.block(1) + "x"), Outcome::ignored);
  std::string other_version = sent.block(1);
  other_version[0] = 2;
  EXPECT_EQ(reader.add(other_version), Outcome::ignored);
  EXPECT_EQ(reader.add(sent.block(1)), Outcome::taken);
  EXPECT_EQ(reader.add(sent.block(2)), Outcome::taken);
  EXPECT_EQ(reader.add(sent.block(2)), Outcome::ignored);
  EXPECT_EQ(reader.text(), sent.text);
}

TEST(CanDocument, IsRefusedWhereItsSumIsWrong) {
  const CanDocument sent = document(5000);
  std::string broken = sent.block(1);
  broken.back() ^= 1;
  CanDocumentReader reader;
  EXPECT_EQ(reader.add(sent.block(0)), Outcome::taken);
  EXPECT_EQ(reader.add(broken), Outcome::damaged);
  EXPECT_FALSE(reader.is_complete());
  EXPECT_EQ(reader.wanted(), 0);
  EXPECT_TRUE(reader.text().empty());
}

}  // namespace
}  // namespace throwcal
