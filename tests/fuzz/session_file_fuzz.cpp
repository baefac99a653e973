// SPDX-License-Identifier: BSD-3-Clause
#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <string>

#include "firmware/input_error.h"
#include "firmware/session_replay.h"
#include "tests/fuzz/outside_text.h"

namespace {

using namespace throwcal;

/// The fuzzer's bytes as a file that needs no disk.
class FileInMemory {
 public:
  FileInMemory(const std::uint8_t* data, std::size_t size) : fd_(memfd_create("session", 0)) {
    require(fd_ >= 0 && write(fd_, data, size) == static_cast<ssize_t>(size), "memory for a file");
  }
  ~FileInMemory() { close(fd_); }
  std::string path() const { return "/proc/self/fd/" + std::to_string(fd_); }

 private:
  int fd_;
};

/// Like outside_text.h's, for either kind of error; SQLite's own words may be longer.
template <class Read>
bool is_read(Read&& read) {
  try {
    read();
    return true;
  } catch (const StoreError& error) {
    require(*error.what() != 0, "an error says something");
  } catch (const InputError& error) {
    require(*error.what() != 0, "an error says something");
  }
  return false;
}

}  // namespace

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const FileInMemory file(data, size);
  is_read([&] {
    const SessionFile session(file.path(), SessionFile::For::reading);
    (void)session.facts();
    (void)session.calibrations();
    (void)session.last_calibration();
    session.each_evidence([](const Evidence& e) {
      require(e.pixels.size() == static_cast<std::size_t>(e.width) * e.height,
              "a picture is whole");
    });
    for (const Track& flight : session.flights()) require(!flight.sightings.empty(), "a flight");
  });
  is_read([&] { (void)SessionReplay(file.path()).throws(); });
  return 0;
}
