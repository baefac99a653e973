// SPDX-License-Identifier: BSD-3-Clause
#include "capture/quotation.h"

#include <cstdio>

namespace throwcal {

std::string printable(std::string_view text, std::size_t enough) {
  constexpr std::string_view hex = "0123456789ABCDEF";
  std::string out;
  for (const char c : text.substr(0, enough)) {
    const auto byte = static_cast<unsigned char>(c);
    if (byte >= 0x20 && byte < 0x7F)
      out += c;
    else
      out += {'\\', 'x', hex[byte >> 4], hex[byte & 15]};
  }
  return text.size() > enough ? out + "..." : out;
}

std::string number_text(double number) {
  char text[32];
  std::snprintf(text, sizeof text, "%.6g", number);
  return text;
}

std::string in_quotes(std::string_view text) { return '"' + printable(text) + '"'; }

}  // namespace throwcal
