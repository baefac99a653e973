// SPDX-License-Identifier: BSD-3-Clause
#include "capture/v4l2_controls.h"

#include <linux/videodev2.h>

#include <array>
#include <cmath>
#include <cstdio>
#include <optional>

namespace throwcal {
namespace {

/// A number of the rig file, the control behind it (the first that the camera has), and what would
/// change it by itself.
struct Number {
  const char* key;
  const char* word;
  std::optional<double> PictureNumbers::*value;
  double unit;  ///< of the control, in the key's
  std::array<std::uint32_t, 2> ids;
  std::uint32_t automatic;  ///< a switch: off is `off`
  std::int32_t off;
};

constexpr std::array numbers{
    Number{"exposure_s",
           "exposure",
           &PictureNumbers::exposure_s,
           1e-4,
           {V4L2_CID_EXPOSURE_ABSOLUTE, 0},
           V4L2_CID_EXPOSURE_AUTO,
           V4L2_EXPOSURE_MANUAL},
    Number{"gain",
           "gain",
           &PictureNumbers::gain,
           1.0,
           {V4L2_CID_GAIN, V4L2_CID_ANALOGUE_GAIN},
           V4L2_CID_AUTOGAIN,
           0},
    Number{"focus",
           "focus",
           &PictureNumbers::focus,
           1.0,
           {V4L2_CID_FOCUS_ABSOLUTE, 0},
           V4L2_CID_FOCUS_AUTO,
           0},
    Number{"white_balance_k",
           "white balance",
           &PictureNumbers::white_balance_k,
           1.0,
           {V4L2_CID_WHITE_BALANCE_TEMPERATURE, 0},
           V4L2_CID_AUTO_WHITE_BALANCE,
           0},
};

/// Lets exposure win over the frame rate: it would stretch frames in the dark.
constexpr std::uint32_t exposure_over_rate = V4L2_CID_EXPOSURE_AUTO_PRIORITY;

std::optional<v4l2_queryctrl> found(const V4l2Device& device, std::uint32_t id) {
  v4l2_queryctrl query{};
  query.id = id;
  if (id == 0 || !device.try_command(VIDIOC_QUERYCTRL, query) ||
      query.flags & V4L2_CTRL_FLAG_DISABLED)
    return std::nullopt;
  return query;
}

std::optional<v4l2_queryctrl> found(const V4l2Device& device, const Number& number) {
  for (const std::uint32_t id : number.ids)
    if (const auto query = found(device, id)) return query;
  return std::nullopt;
}

std::optional<std::int32_t> value_of(const V4l2Device& device, std::uint32_t id) {
  v4l2_control control{id, 0};
  if (!device.try_command(VIDIOC_G_CTRL, control)) return std::nullopt;
  return control.value;
}

bool set(const V4l2Device& device, std::uint32_t id, std::int32_t value) {
  v4l2_control control{id, value};
  return device.try_command(VIDIOC_S_CTRL, control);
}

/// Whether the camera changes this number by itself now.
bool is_automatic(const V4l2Device& device, const Number& number) {
  if (!found(device, number.automatic)) return false;
  return value_of(device, number.automatic) != number.off;
}

std::string text_of(double number) {
  char text[32];
  std::snprintf(text, sizeof text, "%.6g", number);
  return text;
}

/// The control's value for a wish. Throws where the camera does not go that far.
std::int32_t value_for(const V4l2Device& device, const Number& number, double wish,
                       const std::optional<v4l2_queryctrl>& query) {
  const std::string place = device.path() + ": " + number.key + " = " + text_of(wish) + ": ";
  if (!query) throw std::runtime_error(place + "the camera has no such control");
  const double value = wish / number.unit;
  if (value < query->minimum - 0.5 || value > query->maximum + 0.5)
    throw std::runtime_error(place + "the camera goes from " +
                             text_of(number.unit * query->minimum) + " to " +
                             text_of(number.unit * query->maximum));
  const int step = std::max(1, query->step);
  const auto steps = static_cast<std::int32_t>(std::lround((value - query->minimum) / step));
  return query->minimum + step * steps;
}

void set_and_read_back(const V4l2Device& device, const Number& number, std::uint32_t id,
                       std::int32_t value) {
  if (!set(device, id, value)) device.fail(number.key);
  const auto back = value_of(device, id);
  if (back == value) return;
  throw std::runtime_error(device.path() + ": " + number.key + " was set to " +
                           text_of(number.unit * value) + " and reads back as " +
                           (back ? text_of(number.unit * *back) : "nothing"));
}

}  // namespace

std::vector<V4l2Control> list_controls(const V4l2Device& device) {
  std::vector<V4l2Control> out;
  for (const Number& number : numbers) {
    const auto query = found(device, number);
    if (!query) continue;
    out.push_back({number.key, number.unit * query->minimum, number.unit * query->maximum,
                   number.unit * value_of(device, query->id).value_or(0),
                   is_automatic(device, number)});
  }
  return out;
}

V4l2Controls::V4l2Controls(const V4l2Device& device, const PictureWishes& wishes)
    : device_(device), wishes_(wishes) {
  if (!wishes.automatic) hold();
  for (const Number& number : numbers) {
    if (is_automatic(device_, number)) settings_.automatic.push_back(number.word);
    if (const auto query = found(device_, number))
      if (const auto value = value_of(device_, query->id))
        settings_.*number.value = number.unit * *value;
  }
  subscribe();
}

void V4l2Controls::hold() {
  if (found(device_, exposure_over_rate) && set(device_, exposure_over_rate, 0))
    held_.push_back({exposure_over_rate, 0});
  for (const Number& number : numbers) {
    const auto query = found(device_, number);
    auto& wish = wishes_.*number.value;
    // As it is now, while the automatic is still at it: that is what suits the light.
    const auto before = query ? value_of(device_, query->id) : std::nullopt;
    const std::int32_t wanted =
        wish ? value_for(device_, number, *wish, query) : before.value_or(0);
    if (found(device_, number.automatic) && set(device_, number.automatic, number.off))
      held_.push_back({number.automatic, number.off});
    else if (wish && is_automatic(device_, number))
      throw std::runtime_error(device_.path() + ": " + number.key +
                               ": the camera's automatic can't be switched off");
    if (wish)
      set_and_read_back(device_, number, query->id, wanted);
    else if (!before || !set(device_, query->id, wanted))
      continue;  // it has none, or one that can only be looked at
    held_.push_back({query->id, value_of(device_, query->id).value_or(wanted)});
    wish = number.unit * held_.back().value;
  }
}

/// The driver then wakes poll() by POLLPRI when another program changes one. Not all can.
void V4l2Controls::subscribe() const {
  for (const Held& held : held_) {
    v4l2_event_subscription subscription{};
    subscription.type = V4L2_EVENT_CTRL;
    subscription.id = held.id;
    device_.try_command(VIDIOC_SUBSCRIBE_EVENT, subscription);
  }
}

bool V4l2Controls::restore() {
  v4l2_event event{};
  for (int most = 100; most > 0 && device_.try_command(VIDIOC_DQEVENT, event); --most) {
  }
  bool was_changed = false;
  for (const Held& held : held_) {
    if (value_of(device_, held.id) == held.value) continue;
    v4l2_control control{held.id, held.value};
    device_.command(VIDIOC_S_CTRL, control, "VIDIOC_S_CTRL");
    was_changed = true;
  }
  settings_.set_back += was_changed;
  return was_changed;
}

}  // namespace throwcal
