// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/text_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <charconv>
#include <cstring>

#include "firmware/input_error.h"

namespace throwcal {
namespace {

/// A file descriptor that closes itself.
struct Descriptor {
  int fd = -1;
  explicit Descriptor(int value) : fd(value) {}
  ~Descriptor() {
    if (fd >= 0) close(fd);
  }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
};

[[noreturn]] void fail(const std::filesystem::path& file, const char* what, int error) {
  throw InputError(file.string() + ": " + what + ": " + std::strerror(error));
}

void write_all(int fd, std::string_view text, const std::filesystem::path& file) {
  while (!text.empty()) {
    const ssize_t count = write(fd, text.data(), text.size());
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) fail(file, "can't be written", errno);
    text.remove_prefix(static_cast<std::size_t>(count));
  }
}

}  // namespace

std::string read_text_file(const std::filesystem::path& file) {
  const Descriptor in(open(file.c_str(), O_RDONLY | O_CLOEXEC));
  if (in.fd < 0) fail(file, "can't be opened", errno);
  std::string text;
  char block[1 << 16];
  for (;;) {
    const ssize_t count = read(in.fd, block, sizeof block);
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) fail(file, "can't be read", errno);
    if (count == 0) return text;
    text.append(block, static_cast<std::size_t>(count));
  }
}

FilePart read_file_part(const std::filesystem::path& file, std::int64_t offset, std::size_t count) {
  const Descriptor in(open(file.c_str(), O_RDONLY | O_CLOEXEC));
  if (in.fd < 0) fail(file, "can't be opened", errno);
  struct stat facts {};
  if (fstat(in.fd, &facts) != 0) fail(file, "can't be read", errno);
  if (offset < 0 || offset > facts.st_size)
    throw InputError(file.string() + ": offset " + std::to_string(offset) + " is not within its " +
                     std::to_string(facts.st_size) + " bytes");
  FilePart out{facts.st_size, std::string(count, '\0')};
  ssize_t got = 0;
  do got = pread(in.fd, out.bytes.data(), count, offset);
  while (got < 0 && errno == EINTR);
  if (got < 0) fail(file, "can't be read", errno);
  out.bytes.resize(static_cast<std::size_t>(got));
  return out;
}

void write_text_file(const std::filesystem::path& file, std::string_view text, unsigned mode) {
  std::error_code ignored;
  if (std::filesystem::exists(file, ignored) && !std::filesystem::is_regular_file(file, ignored)) {
    const Descriptor out(open(file.c_str(), O_WRONLY | O_CLOEXEC));  // a pipe or a terminal
    if (out.fd < 0) fail(file, "can't be opened for writing", errno);
    return write_all(out.fd, text, file);
  }
  const std::filesystem::path draft = file.string() + ".part" + std::to_string(getpid());
  const Descriptor out(open(draft.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, mode));
  if (out.fd < 0) fail(file, "can't be written", errno);
  try {
    write_all(out.fd, text, file);
    if (fsync(out.fd) != 0) fail(file, "can't be synced", errno);
    if (rename(draft.c_str(), file.c_str()) != 0) fail(file, "can't be put in place", errno);
  } catch (...) {
    unlink(draft.c_str());
    throw;
  }
  const std::filesystem::path folder = file.has_parent_path() ? file.parent_path() : ".";
  const Descriptor directory(open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (directory.fd >= 0) fsync(directory.fd);  // the new name itself
}

std::string shortest(double value) {
  char text[32];
  return {text, std::to_chars(text, text + sizeof text, value).ptr};
}

}  // namespace throwcal
