// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/listen_address.h"

#include <charconv>

namespace throwcal {

std::optional<ListenAddress> parse_address(std::string_view text, int default_port) {
  ListenAddress out{.host = std::string(text), .port = default_port};
  const std::size_t colon = text.rfind(':');
  const bool bracketed = text.starts_with('[');
  const bool bare_v6 = !bracketed && colon != text.npos && text.find(':') != colon;
  if (colon != text.npos && !bare_v6 && !text.ends_with(']')) {
    const std::string_view port = text.substr(colon + 1);
    const auto [end, error] = std::from_chars(port.data(), port.data() + port.size(), out.port);
    if (error != std::errc{} || end != port.data() + port.size()) return {};
    if (out.port < 0 || out.port > 65535) return {};
    out.host = std::string(text.substr(0, colon));
  }
  if (bracketed) {
    if (!out.host.ends_with(']')) return {};
    out.host = out.host.substr(1, out.host.size() - 2);
  }
  if (out.host.empty()) return {};
  return out;
}

std::string to_text(const ListenAddress& address) {
  const bool is_v6 = address.host.find(':') != std::string::npos;
  return (is_v6 ? "[" + address.host + "]" : address.host) + ":" + std::to_string(address.port);
}

}  // namespace throwcal
