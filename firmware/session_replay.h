// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "estimator/observation.h"
#include "firmware/config.h"
#include "firmware/session_file.h"

namespace throwcal {

/// A session's rig file as its box understood it. Throws InputError naming `file`.
Config config_of(const SessionFacts& facts, const std::string& file);

/// A box's session on another machine: what its last calibration was made of, to make it again.
class SessionReplay {
 public:
  using Json = nlohmann::ordered_json;

  /// Throws StoreError or InputError naming the file and what is wrong in it.
  explicit SessionReplay(const std::filesystem::path& file);

  const SessionFacts& facts() const { return facts_; }
  const Config& config() const { return config_; }  ///< of the rig file as it was
  const std::optional<StoredCalibration>& original() const { return original_; }
  const std::vector<Track>& flights() const { return flights_; }  ///< all of them
  std::vector<Throw> throws() const;                              ///< of all of them

  /// The calibration document once more, of the flights that the box's own is of: the same, to the
  /// byte, where the software is the same.
  Json calibrate_again() const;
  /// Whether it is, in a sentence.
  std::string comparison(const Json& document) const;

 private:
  std::size_t calibrated_flights() const;
  std::vector<Throw> throws_of(std::size_t flights) const;

  SessionFacts facts_;
  std::optional<StoredCalibration> original_;
  std::vector<Track> flights_;
  Config config_;
};

}  // namespace throwcal
