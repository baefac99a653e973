// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/sightings_file.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <map>
#include <optional>
#include <tuple>

#include "capture/quotation.h"
#include "firmware/decimal_time.h"
#include "firmware/input_error.h"
#include "firmware/number_range.h"
#include "firmware/text_file.h"

namespace throwcal {
namespace {

/// Wide, for linking to survive a poor detector; every consumer learns the true scale from the
/// data.
constexpr double unstated_sigma_px = 1.0;

/// 126 years either way, since 1970 too: the difference of two such times fits 64 bits of
/// nanoseconds.
constexpr std::chrono::seconds most_time(4'000'000'000);

/// A lens' undistortion throws what lies near its horizon far out; such a row is clutter, no error.
const NumberRange pixel_range = between(-1e5, 1e5, "a number of pixels");
NumberRange radius_range(const CameraModel& model) {
  return between(0.01, model.width_px + model.height_px, "a number of pixels");
}

enum Column : std::size_t {
  camera,
  time_s,
  u_px,
  v_px,
  radius_px,
  label,
  sigma_u_px,
  sigma_v_px,
  correlation_uv,
  partial,
  columns
};
constexpr std::array<std::string_view, columns> column_names{
    "camera", "time_s",     "u_px",       "v_px",           "radius_px",
    "throw",  "sigma_u_px", "sigma_v_px", "correlation_uv", "partial"};
constexpr double max_correlation = 0.999;
const NumberRange sigma_range = between(1e-6, 100, "a number of pixels");
const NumberRange correlation_range = between(-max_correlation, max_correlation, "a number");
const NumberRange flag_range = between(0, 1);

std::string_view trimmed(std::string_view text) {
  constexpr std::string_view blank = " \t\r";
  const std::size_t first = text.find_first_not_of(blank);
  if (first == text.npos) return {};
  return text.substr(first, text.find_last_not_of(blank) - first + 1);
}

/// Cells of one line; quotes around a cell are taken off, a quote within quotes is doubled.
std::vector<std::string> split(std::string_view line) {
  std::vector<std::string> cells(1);
  bool quoted = false;
  for (std::size_t i = 0; i < line.size(); ++i) {
    const char c = line[i];
    if (c == '"' && quoted && i + 1 < line.size() && line[i + 1] == '"') {
      cells.back() += line[++i];
    } else if (c == '"') {
      quoted = !quoted;
    } else if (c == ',' && !quoted) {
      cells.emplace_back();
    } else {
      cells.back() += c;
    }
  }
  for (std::string& cell : cells) cell = std::string(trimmed(cell));
  return cells;
}

class SightingsParser {
 public:
  SightingsParser(const std::string& name, const RigDescription& rig) : name_(name), rig_(rig) {}

  std::vector<SightingRow> parse(std::string_view csv) {
    if (csv.starts_with("\xEF\xBB\xBF")) csv.remove_prefix(3);  // a spreadsheet's byte order mark
    while (!csv.empty()) {
      const std::size_t end = std::min(csv.find('\n'), csv.size());
      take_line(trimmed(csv.substr(0, end)));
      csv.remove_prefix(std::min(end + 1, csv.size()));
    }
    const std::string expected =
        "; expected at least a header and one row: camera,time_s,u_px,v_px";
    if (!has_header_) throw InputError(name_ + ": is empty" + expected);
    if (rows_.empty()) throw InputError(name_ + ": holds no sighting" + expected);
    return std::move(rows_);
  }

 private:
  [[noreturn]] void reject(const std::string& what) const {
    throw InputError(name_ + ":" + std::to_string(line_) + ": " + what);
  }

  void take_line(std::string_view line) {
    ++line_;
    if (line.empty()) return;
    if (has_header_)
      take_row(split(line));
    else
      take_header(split(line));
  }

  void take_header(const std::vector<std::string>& cells) {
    has_header_ = true;
    width_ = cells.size();
    for (std::size_t i = 0; i < cells.size(); ++i) {
      const auto known = std::ranges::find(column_names, cells[i]);
      if (known == column_names.end()) continue;  // what a reader doesn't know, it ignores
      auto& place = place_[static_cast<std::size_t>(known - column_names.begin())];
      if (place) reject("column " + cells[i] + " stands twice; expected it once");
      place = i;
    }
    for (const Column column : {camera, time_s, u_px, v_px})
      if (!place_[column])
        reject("column " + std::string(column_names[column]) +
               " is missing; expected the header camera,time_s,u_px,v_px[,radius_px][,throw]");
    if (place_[sigma_u_px].has_value() != place_[sigma_v_px].has_value())
      reject("of the columns sigma_u_px and sigma_v_px one is missing; expected both or neither");
  }

  void take_row(const std::vector<std::string>& cells) {
    if (cells.size() != width_)
      reject("expected " + std::to_string(width_) + " columns as in the header, got " +
             std::to_string(cells.size()));
    SightingRow row;
    BallSighting& s = row.sighting;
    s.camera = camera_id(cells[*place_[camera]]);
    const CameraDescription& seen_by = rig_.cameras[s.camera];
    s.time = time(cells);
    s.center_px = {number(u_px, pixel_range, cells), number(v_px, pixel_range, cells)};
    const double unmeasured = seen_by.sigma_px.value_or(unstated_sigma_px);
    const double sigma_u = optional_number(sigma_u_px, sigma_range, cells).value_or(unmeasured);
    const double sigma_v = optional_number(sigma_v_px, sigma_range, cells).value_or(unmeasured);
    const double cov_uv =
        optional_number(correlation_uv, correlation_range, cells).value_or(0.0) * sigma_u * sigma_v;
    s.cov_px2 << sigma_u * sigma_u, cov_uv, cov_uv, sigma_v * sigma_v;
    s.radius_px = optional_number(radius_px, radius_range(seen_by.model), cells);
    s.is_partial = optional_number(partial, flag_range, cells).value_or(0.0) > 0.5;
    if (place_[label]) row.throw_id = cells[*place_[label]];
    s.id = rows_.size() + 1;
    check_unique(row);
    rows_.push_back(std::move(row));
  }

  CameraId camera_id(const std::string& name) const {
    for (CameraId id = 0; id < rig_.cameras.size(); ++id)
      if (rig_.cameras[id].name == name) return id;
    std::string expected;
    for (const auto& c : rig_.cameras) expected += (expected.empty() ? "" : ", ") + c.name;
    reject("camera " + in_quotes(name) + " is not in the rig file; expected one of " + expected);
  }

  HostTime time(const std::vector<std::string>& cells) const {
    const auto value = parse_time(cells[*place_[time_s]]);
    if (!value || std::chrono::abs(value->time_since_epoch()) > most_time)
      expect(time_s, "a number of seconds from -4e+09 to 4e+09", cells);
    return *value;
  }

  double number(Column column, const NumberRange& range,
                const std::vector<std::string>& cells) const {
    std::string_view text = cells[*place_[column]];
    if (text.starts_with('+') && !text.starts_with("+-")) text.remove_prefix(1);
    double value = 0.0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (error != std::errc{} || end != text.data() + text.size() || !range.holds(value))
      expect(column, range.text, cells);
    return value;
  }

  /// Nothing where the column is absent or the cell empty.
  std::optional<double> optional_number(Column column, const NumberRange& range,
                                        const std::vector<std::string>& cells) const {
    if (!place_[column] || cells[*place_[column]].empty()) return std::nullopt;
    return number(column, range, cells);
  }

  [[noreturn]] void expect(Column column, const std::string& what,
                           const std::vector<std::string>& cells) const {
    reject(std::string(column_names[column]) + " must be " + what + ", got " +
           in_quotes(cells[*place_[column]]));
  }

  /// A file pasted twice would count each sighting twice, and promise too small a sigma.
  void check_unique(const SightingRow& row) {
    if (row.throw_id.empty()) return;  // several blobs a frame
    const auto [first, is_new] =
        line_of_.emplace(std::tuple(row.throw_id, row.sighting.camera, row.sighting.time), line_);
    if (!is_new)
      reject("camera \"" + rig_.cameras[row.sighting.camera].name + "\" sees throw " +
             in_quotes(row.throw_id) + " at this time in line " + std::to_string(first->second) +
             " already; expected one row a frame");
  }

  const std::string& name_;
  const RigDescription& rig_;
  std::vector<SightingRow> rows_;
  std::array<std::optional<std::size_t>, columns> place_{};
  std::map<std::tuple<ThrowId, CameraId, HostTime>, std::size_t> line_of_;
  std::size_t line_ = 0, width_ = 0;
  bool has_header_ = false;
};

/// A cell that may hold anything.
std::string quoted_if_needed(const std::string& text) {
  if (text.find_first_of(",\"") == text.npos) return text;
  std::string out = "\"";
  for (const char c : text) out += c == '"' ? "\"\"" : std::string(1, c);
  return out + '"';
}

/// Rows in an order of their own, whatever that of the file: the same rows make the same throws.
std::vector<const SightingRow*> in_order(const std::vector<SightingRow>& rows) {
  std::vector<const SightingRow*> out;
  for (const SightingRow& row : rows) out.push_back(&row);
  std::ranges::stable_sort(out, {}, [](const SightingRow* row) {
    const BallSighting& s = row->sighting;
    return std::tuple(s.time, s.camera, std::string_view(row->throw_id), s.center_px.x(),
                      s.center_px.y());
  });
  return out;
}

std::string fixed(double value, int decimals) {
  char text[64];
  const auto end =
      std::to_chars(text, text + sizeof text, value, std::chars_format::fixed, decimals);
  return end.ec == std::errc{} ? std::string(text, end.ptr) : shortest(value);
}

}  // namespace

std::vector<SightingRow> parse_sightings(std::string_view csv, const std::string& name,
                                         const RigDescription& rig) {
  return SightingsParser(name, rig).parse(csv);
}

std::vector<SightingRow> read_sightings(const std::filesystem::path& file,
                                        const RigDescription& rig) {
  return parse_sightings(read_text_file(file), file.string(), rig);
}

std::vector<Throw> labelled_throws(const std::vector<SightingRow>& rows) {
  std::vector<Throw> throws;
  std::map<ThrowId, std::size_t> place;
  for (const SightingRow* row : in_order(rows)) {
    if (row->throw_id.empty()) continue;
    const auto [at, is_new] = place.emplace(row->throw_id, throws.size());
    if (is_new) throws.push_back({row->throw_id, {}});
    auto& tracks = throws[at->second].tracks;
    auto track = std::ranges::find(tracks, row->sighting.camera, &Track::camera);
    if (track == tracks.end()) track = tracks.insert(track, {row->sighting.camera, {}});
    track->sightings.push_back(row->sighting);
  }
  for (Throw& thrown : throws) std::ranges::sort(thrown.tracks, {}, &Track::camera);
  return throws;
}

std::vector<FrameSightings> unlabelled_frames(const std::vector<SightingRow>& rows) {
  std::vector<FrameSightings> frames;
  for (const SightingRow* row : in_order(rows)) {
    if (!row->throw_id.empty()) continue;
    const BallSighting& s = row->sighting;
    if (frames.empty() || frames.back().time != s.time || frames.back().camera != s.camera)
      frames.push_back({s.camera, s.time, {}});
    frames.back().sightings.push_back(s);
  }
  return frames;
}

std::string to_sightings_csv(const std::vector<SightingRow>& rows, const RigDescription& rig,
                             bool with_errors) {
  const bool radii =
      std::ranges::any_of(rows, [](const auto& r) { return r.sighting.radius_px.has_value(); });
  const bool labels = std::ranges::any_of(rows, [](const auto& r) { return !r.throw_id.empty(); });
  std::string out = "camera,time_s,u_px,v_px";
  out += radii ? ",radius_px" : "";
  out += labels ? ",throw" : "";
  out += with_errors ? ",sigma_u_px,sigma_v_px,correlation_uv,partial\n" : "\n";
  for (const auto& [s, throw_id] : rows) {
    out += rig.cameras[s.camera].name + ',' + to_decimal_seconds(s.time) + ',' +
           fixed(s.center_px.x(), 5) + ',' + fixed(s.center_px.y(), 5);
    if (radii) out += ',' + (s.radius_px ? fixed(*s.radius_px, 3) : std::string());
    if (labels) out += ',' + quoted_if_needed(throw_id);
    if (with_errors) {
      const double sigma_u = std::sqrt(s.cov_px2(0, 0)), sigma_v = std::sqrt(s.cov_px2(1, 1));
      const double correlation =
          std::clamp(s.cov_px2(0, 1) / (sigma_u * sigma_v), -max_correlation, max_correlation);
      out += ',' + fixed(sigma_u, 6) + ',' + fixed(sigma_v, 6) + ',' + fixed(correlation, 4) +
             (s.is_partial ? ",1" : ",0");
    }
    out += '\n';
  }
  return out;
}

std::string to_residuals_csv(const std::vector<BallSighting>& sightings,
                             const Calibration& calibration) {
  std::map<std::uint64_t, const SightingResidual*> residual_of;
  for (const SightingResidual& r : calibration.residuals) residual_of[r.sighting_id] = &r;
  std::string out = "camera,time_s,u_px,v_px,throw,used,residual_u_px,residual_v_px\n";
  for (const BallSighting& s : sightings) {
    const auto found = residual_of.find(s.id);
    const SightingResidual* r = found == residual_of.end() ? nullptr : found->second;
    out += calibration.cameras.at(s.camera).name + ',' + to_decimal_seconds(s.time) + ',' +
           fixed(s.center_px.x(), 5) + ',' + fixed(s.center_px.y(), 5) + ',';
    out += (r ? quoted_if_needed(r->throw_id) : "") + (r && r->used ? ",1," : ",0,");
    if (r && r->residual_px.allFinite())
      out += fixed(r->residual_px.x(), 5) + ',' + fixed(r->residual_px.y(), 5);
    else
      out += ',';
    out += '\n';
  }
  return out;
}

}  // namespace throwcal
