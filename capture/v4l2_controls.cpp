// SPDX-License-Identifier: BSD-3-Clause
#include "capture/v4l2_controls.h"

#include <linux/videodev2.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <optional>

#include "capture/quotation.h"

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

/// The control's nearest value to a number of the rig file.
std::int32_t nearest(const v4l2_queryctrl& query, double value) {
  const std::int64_t step = std::max(1, query.step);
  const std::int64_t most = (std::int64_t{query.maximum} - query.minimum) / step;
  const auto steps = std::llround((value - query.minimum) / static_cast<double>(step));
  return static_cast<std::int32_t>(query.minimum + step * std::clamp<std::int64_t>(steps, 0, most));
}

/// Throws where the camera does not go that far, or does not obey.
void set_wish(const V4l2Device& device, const Number& number, double wish) {
  const std::string place = device.path() + ": " + number.key + " = " + number_text(wish) + ": ";
  const auto query = found(device, number);
  if (!query) throw std::runtime_error(place + "the camera has no such control");
  const double value = wish / number.unit;
  if (value < query->minimum - 0.5 || value > query->maximum + 0.5)
    throw std::runtime_error(place + "the camera goes from " +
                             number_text(number.unit * query->minimum) + " to " +
                             number_text(number.unit * query->maximum));
  if (is_automatic(device, number) && !set(device, number.automatic, number.off))
    throw std::runtime_error(place + "the camera's automatic can't be switched off");
  const std::int32_t wanted = nearest(*query, value);
  if (!set(device, query->id, wanted)) device.fail(number.key);
  const auto back = value_of(device, query->id);
  if (!back || std::abs(std::int64_t{*back} - wanted) > std::max(1, query->step))
    throw std::runtime_error(place + "it reads back as " +
                             (back ? number_text(number.unit * *back) : "nothing"));
}

/// As far as the camera goes along.
void try_number(const V4l2Device& device, const Number& number, double value) {
  const auto query = found(device, number);
  if (is_automatic(device, number)) set(device, number.automatic, number.off);
  if (query) set(device, query->id, nearest(*query, value / number.unit));
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

V4l2Controls::V4l2Controls(const V4l2Device& device, const PictureWishes& wishes,
                           const PictureNumbers& remembered)
    : device_(device), is_automatic_wanted_(wishes.automatic) {
  if (!wishes.automatic && found(device_, exposure_over_rate) &&
      set(device_, exposure_over_rate, 0))
    hold(exposure_over_rate, 0);
  for (const Number& number : numbers) {
    if (wishes.automatic) break;
    if (const auto& wish = wishes.*number.value)
      set_wish(device_, number, *wish);
    else if (const auto& before = remembered.*number.value)
      try_number(device_, number, *before);
    const auto query = found(device_, number);
    if (is_automatic(device_, number)) continue;  // it may find what suits the light
    if (found(device_, number.automatic)) hold(number.automatic, number.off);
    if (query && !(query->flags & V4L2_CTRL_FLAG_READ_ONLY))
      if (const auto value = value_of(device_, query->id)) hold(query->id, *value);
  }
  read_settings();
}

void V4l2Controls::hold_the_rest() {
  if (is_automatic_wanted_) return;
  // First read all: of some cameras the exposure's automatic changes the gain, too.
  std::array<std::optional<std::int32_t>, numbers.size()> values;
  for (std::size_t i = 0; i < numbers.size(); ++i)
    if (const auto query = found(device_, numbers[i])) values[i] = value_of(device_, query->id);
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    if (!is_automatic(device_, numbers[i])) continue;
    if (!set(device_, numbers[i].automatic, numbers[i].off)) continue;
    hold(numbers[i].automatic, numbers[i].off);
    const auto query = found(device_, numbers[i]);
    if (!query || !values[i]) continue;
    set(device_, query->id, *values[i]);
    hold(query->id, value_of(device_, query->id).value_or(*values[i]));
  }
  set_again();  // a gain that was wished for, and that the exposure's automatic had changed
  read_settings();
  for (const Number& number : numbers)
    if (is_automatic(device_, number)) settings_.automatic.push_back(number.word);
}

/// The driver then wakes poll() by POLLPRI when another program changes it. Not all can.
void V4l2Controls::hold(std::uint32_t id, std::int32_t value) {
  held_.push_back({id, value});
  v4l2_event_subscription subscription{};
  subscription.type = V4L2_EVENT_CTRL;
  subscription.id = id;
  device_.try_command(VIDIOC_SUBSCRIBE_EVENT, subscription);
}

/// What an automatic changes is nobody's setting.
void V4l2Controls::read_settings() {
  settings_ = {};
  for (const Number& number : numbers) {
    const auto query = found(device_, number);
    if (is_automatic(device_, number)) {
      if (is_automatic_wanted_) settings_.automatic.push_back(number.word);
    } else if (query) {
      if (const auto value = value_of(device_, query->id))
        settings_.*number.value = number.unit * *value;
    }
  }
}

void V4l2Controls::set_again() {
  for (const Held& held : held_) set(device_, held.id, held.value);
}

bool V4l2Controls::restore() {
  v4l2_event event{};
  for (int most = 100; most > 0 && device_.try_command(VIDIOC_DQEVENT, event); --most) {
  }
  bool was_changed = false;
  for (const Held& held : held_) {
    const auto now = value_of(device_, held.id);
    if (!now && (errno == ENODEV || errno == ENXIO)) device_.fail("VIDIOC_G_CTRL");
    if (!now || now == held.value || !set(device_, held.id, held.value)) continue;
    was_changed |= value_of(device_, held.id) == held.value;
  }
  return was_changed;
}

}  // namespace throwcal
