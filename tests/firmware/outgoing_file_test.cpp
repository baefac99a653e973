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

/// After one piece more.
std::string found(FileDigests& digests, const OutgoingFile& file) {
  const auto digest = digests.look_further(file);
  return digest ? to_hex(*digest) : "not yet";
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

TEST_F(Outgoing, DigestIsFoundInPiecesOnceForAllAndRemembered) {
  const std::string text(2 * FileDigests::piece_bytes + 1, 'a');
  write(text);
  FileDigests digests;
  const OutgoingFile one(path), same(path);
  EXPECT_EQ(found(digests, one), "not yet");
  EXPECT_EQ(found(digests, same), "not yet");
  EXPECT_EQ(found(digests, same), sha256_hex(text)) << "what was looked at counts for both";
  EXPECT_EQ(found(digests, one), sha256_hex(text));
  write("");
  EXPECT_EQ(found(digests, OutgoingFile(path)), sha256_hex(""));
  write("b");
  EXPECT_EQ(found(digests, OutgoingFile(path)), sha256_hex("b"));
}

TEST_F(Outgoing, DigestOfWhatIsWrittenToMeanwhileIsNone) {
  write(std::string(FileDigests::piece_bytes + 1, 'a'));
  FileDigests digests;
  const OutgoingFile file(path);
  EXPECT_EQ(found(digests, file), "not yet");
  write("b", std::ios::app);
  EXPECT_THROW(digests.look_further(file), InputError);
}

TEST_F(Outgoing, DigestsOfManyFilesAreForgotten) {
  FileDigests digests;
  const std::string text(FileDigests::piece_bytes + 1, 'a');
  write(text);
  const OutgoingFile first(path);
  EXPECT_EQ(found(digests, first), "not yet");
  for (std::size_t i = 0; i < FileDigests::remembered; ++i) {
    const std::filesystem::path other = path.string() + "_other";
    std::ofstream(other) << std::string(i + 1, 'b');
    EXPECT_EQ(found(digests, OutgoingFile(other)), sha256_hex(std::string(i + 1, 'b')));
    std::filesystem::remove(other);
  }
  EXPECT_EQ(found(digests, first), "not yet") << "begun again";
  EXPECT_EQ(found(digests, first), sha256_hex(text));
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
