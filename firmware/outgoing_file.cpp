// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/outgoing_file.h"

#include <fcntl.h>
#include <sys/stat.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <iterator>
#include <vector>

#include "firmware/input_error.h"

namespace throwcal {
namespace {

/// Nothing where that can't be told, or it is no file.
std::optional<OutgoingFile::Stamp> stamp_of(int fd) {
  struct stat facts {};
  if (fstat(fd, &facts) != 0 || !S_ISREG(facts.st_mode)) return {};
  return OutgoingFile::Stamp{facts.st_dev, facts.st_ino, static_cast<std::uint64_t>(facts.st_size),
                             facts.st_mtim.tv_sec * 1'000'000'000 + facts.st_mtim.tv_nsec};
}

}  // namespace

OutgoingFile::OutgoingFile(const std::filesystem::path& file)
    : file_(open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK)) {
  if (!file_.is_open())
    throw InputError(file.string() + ": can't be opened: " + std::strerror(errno));
  const auto stamp = stamp_of(file_.get());
  if (!stamp) throw InputError(file.string() + ": can't be read; expected a file");
  stamp_ = *stamp;
}

std::optional<std::size_t> OutgoingFile::read(std::uint64_t offset, std::span<char> out) const {
  if (offset >= bytes()) return 0;
  const std::size_t most = std::min<std::uint64_t>(out.size(), bytes() - offset);
  ssize_t count = 0;
  do count = pread(file_.get(), out.data(), most, static_cast<off_t>(offset));
  while (count < 0 && errno == EINTR);
  if (count <= 0 || stamp_of(file_.get()) != stamp_) return {};
  return static_cast<std::size_t>(count);
}

std::optional<Sha256Digest> FileDigests::look_further(const OutgoingFile& file) {
  auto search = std::ranges::find(searches_, file.stamp(), &Search::stamp);
  if (search == searches_.end()) {
    if (searches_.size() >= remembered) searches_.pop_front();
    searches_.push_back({file.stamp()});
    search = std::prev(searches_.end());
  }
  if (search->digest) return search->digest;
  std::vector<char> piece(piece_bytes);
  const auto count = file.read(search->looked_at_bytes, piece);
  if (!count)
    throw InputError("the file was written to while it was read, or can't be read: ask again");
  search->hash.add({piece.data(), *count});
  search->looked_at_bytes += *count;
  if (search->looked_at_bytes == file.bytes()) search->digest = search->hash.digest();
  return search->digest;
}

}  // namespace throwcal
