// SPDX-License-Identifier: BSD-3-Clause
#include "capture/usb_load.h"

#include <algorithm>
#include <cstdio>
#include <map>

namespace throwcal {
namespace {

std::string one_decimal(double number) {
  char text[32];
  std::snprintf(text, sizeof text, "%.1f", number);
  return text;
}

}  // namespace

double usb_capacity_mb_per_s(double link_mbps) {
  return 0.8 * link_mbps / (link_mbps > 480.0 ? 10.0 : 8.0);
}

std::vector<std::string> usb_overloads(const std::vector<UsbStream>& streams) {
  struct Segment {
    double capacity = 0.0, sum = 0.0;
    std::string each;
  };
  std::map<std::string, Segment> segments;
  for (const UsbStream& stream : streams) {
    Segment& segment = segments[stream.segment];
    segment.capacity = std::max(segment.capacity, usb_capacity_mb_per_s(stream.link_mbps));
    segment.sum += stream.megabytes_per_s;
    segment.each += (segment.each.empty() ? "" : ", ") + stream.camera + " " +
                    (stream.megabytes_per_s > 0 ? one_decimal(stream.megabytes_per_s)
                                                : "what its compressed pictures take");
  }
  std::vector<std::string> out;
  for (const auto& [name, segment] : segments)
    if (segment.capacity > 0 && segment.sum > segment.capacity)
      out.push_back(name + " carries " + one_decimal(segment.capacity) + " MB/s of pictures, but " +
                    one_decimal(segment.sum) + " are wanted (" + segment.each + "): " + usb_remedy);
  return out;
}

}  // namespace throwcal
