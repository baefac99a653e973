// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/outgoing_file.h"

#include <gtest/gtest.h>

#include <fstream>

#include "firmware/input_error.h"
#include "tests/support/temporary_folder.h"

namespace throwcal {
namespace {

class Outgoing : public ::testing::Test {
 protected:
  Outgoing() { write("0123456789"); }
  void write(const std::string& text, std::ios::openmode mode = std::ios::trunc) const {
    std::ofstream(path, mode) << text;
  }
  static std::string part(const OutgoingFile& file, std::uint64_t offset, std::size_t most) {
    std::string out(most, ' ');
    const auto count = file.read(offset, out);
    return count ? out.substr(0, *count) : "nothing";
  }
  test::TemporaryFolder folder;
  std::filesystem::path path = folder.path() / "file";
};

std::optional<std::string> found(FileDigests& digests, FileDigests::Search& search, int turns) {
  std::optional<Sha256Digest> digest;
  while (!digest && turns-- > 0) digest = digests.look_further(search);
  return digest ? std::optional(to_hex(*digest)) : std::nullopt;
}

TEST_F(Outgoing, IsReadInParts) {
  const OutgoingFile file(path);
  EXPECT_EQ(file.bytes(), 10u);
  EXPECT_EQ(part(file, 0, 4), "0123");
  EXPECT_EQ(part(file, 8, 4), "89");
  EXPECT_EQ(part(file, 10, 4), "");
  EXPECT_EQ(part(file, 1u << 31, 4), "");
}

TEST_F(Outgoing, EndsWhereItIsWrittenToButNotWhereItIsRemoved) {
  const OutgoingFile removed(path);
  std::filesystem::remove(path);
  EXPECT_EQ(part(removed, 0, 4), "0123");
  write("0123456789");
  const OutgoingFile longer(path);
  write("more", std::ios::app);
  EXPECT_EQ(part(longer, 0, 4), "nothing");
  const OutgoingFile shorter(path);
  write("");
  EXPECT_EQ(part(shorter, 0, 4), "nothing");
  write("abc");
  const OutgoingFile touched(path);
  std::filesystem::last_write_time(path, std::filesystem::file_time_type{});
  EXPECT_EQ(part(touched, 0, 4), "nothing");
}

TEST_F(Outgoing, WhatIsNoFileIsRefused) {
  EXPECT_THROW(OutgoingFile(path.string() + ".none"), InputError);
  EXPECT_THROW(OutgoingFile(folder.path()), InputError);
}

TEST_F(Outgoing, DigestIsFoundInPiecesAndRemembered) {
  const std::string text(FileDigests::piece_bytes + 1, 'a');
  write(text);
  FileDigests digests;
  FileDigests::Search first(std::make_shared<OutgoingFile>(path));
  EXPECT_FALSE(found(digests, first, 1));
  EXPECT_EQ(found(digests, first, 1), sha256_hex(text));
  FileDigests::Search again(std::make_shared<OutgoingFile>(path));
  EXPECT_EQ(found(digests, again, 1), sha256_hex(text));
  write("");
  FileDigests::Search empty(std::make_shared<OutgoingFile>(path));
  EXPECT_EQ(found(digests, empty, 1), sha256_hex(""));
}

TEST_F(Outgoing, DigestOfWhatIsWrittenToMeanwhileIsNone) {
  write(std::string(FileDigests::piece_bytes + 1, 'a'));
  FileDigests digests;
  FileDigests::Search search(std::make_shared<OutgoingFile>(path));
  EXPECT_FALSE(found(digests, search, 1));
  write("b", std::ios::app);
  EXPECT_THROW(digests.look_further(search), InputError);
}

TEST(Sha256, OfPiecesIsThatOfTheWhole) {
  Sha256 pieces;
  pieces.add("ab");
  EXPECT_EQ(pieces.digest(), sha256("ab"));
  pieces.add("");
  pieces.add("c");
  EXPECT_EQ(to_hex(pieces.digest()),
            "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");  // FIPS 180-2
}

}  // namespace
}  // namespace throwcal
