// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <chrono>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>
#include <string>

#include "firmware/config.h"

namespace throwcal {

/// The box is not there, or says no. what() is one line for the person at the shell.
struct BoxError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// One connection to a throwcald: JSON-RPC 2.0, one object a line. Blocks.
class BoxClient {
 public:
  using Json = nlohmann::ordered_json;

  /// Connects and waits for `hello`. Throws BoxError: "no box answers at HOST:PORT (...)".
  explicit BoxClient(const ListenAddress& address);
  ~BoxClient();
  BoxClient(const BoxClient&) = delete;
  BoxClient& operator=(const BoxClient&) = delete;

  const Json& hello() const { return hello_; }
  /// The result of a method; throws BoxError with the box's own words where it refuses.
  Json call(const std::string& method, const Json& params = Json::object());
  /// The next notification's params; nothing when `timeout` has passed.
  std::optional<Json> notification(std::chrono::milliseconds timeout);

 private:
  std::optional<Json> message(std::chrono::milliseconds timeout);

  std::string place_;
  int fd_ = -1;
  std::int64_t last_id_ = 0;
  std::string input_;
  Json hello_;
};

}  // namespace throwcal
