// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

namespace throwcal {

/// Who may change something: whoever knows the box's token, or anybody soon after somebody pressed
/// its button. Reading is open to all.
class Access {
 public:
  using Clock = std::chrono::steady_clock;
  static constexpr std::chrono::seconds window{60};  ///< that a press opens

  explicit Access(std::string token) : token_(std::move(token)) {}

  /// Compared in a time that does not depend on where the two differ.
  bool knows(std::string_view token) const;
  /// What stands for the token where there is no room for it (CAN): the first four bytes of its
  /// SHA-256, most significant first.
  std::uint32_t short_key() const;

  void renew(std::string token) { token_ = std::move(token); }

  void button_pressed(Clock::time_point now) { open_until_ = now + window; }
  bool is_open(Clock::time_point now) const { return open_until_ && now < *open_until_; }

 private:
  std::string token_;
  std::optional<Clock::time_point> open_until_;
};

/// 128 random bits in hexadecimal.
std::string new_token();

/// The token in this file: its first line. Where there is no file, new_token() is kept
/// there, readable by its owner and group only. Throws InputError
/// where the file can't be read or made, or holds fewer than 8 or more than 128 printable
/// characters.
std::string token_in(const std::filesystem::path& file);

/// A new one takes its place, in the file and as the result. Throws InputError where it can't be
/// written; then the old one is still there.
std::string new_token_in(const std::filesystem::path& file);

}  // namespace throwcal
