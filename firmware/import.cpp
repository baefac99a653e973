// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>

#include "capture/quotation.h"
#include "firmware/export.h"
#include "firmware/input_error.h"
#include "firmware/number_range.h"
#include "firmware/text_file.h"

namespace throwcal {
namespace {

/// Of a throw: the nanoseconds of any two such times have a difference in 64 bits.
const NumberRange time_s = between(-4e9, 4e9, "a number of seconds");
const NumberRange sightings_count = between(0, 1e9);
/// Of a guess, beyond which no refinement finds its way, nor should a flight be followed.
const NumberRange metres = between(-1e5, 1e5, "a number of metres");
const NumberRange offset_s = between(-10, 10, "a number of seconds");
const NumberRange drag_per_m = between(-1, 10);

/// Reads values of one calibration document and names the place of what is not as it should be.
class Reader {
 public:
  Reader(const Json& value, std::string place) : value_(value), place_(std::move(place)) {}

  Reader operator[](const std::string& key) const {
    static const Json absent;
    const bool there = value_.is_object() && value_.contains(key);
    return {there ? value_.at(key) : absent, place_ + " " + key};
  }
  bool is_null() const { return value_.is_null(); }
  const Json& json() const { return value_; }

  double number(const NumberRange& range = {}) const {
    if (!value_.is_number() || !range.holds(value_.get<double>())) expect(range.text);
    return value_.get<double>();
  }
  std::optional<double> optional_number(const NumberRange& range = {}) const {
    return is_null() ? std::nullopt : std::optional(number(range));
  }
  std::string text() const {
    if (!value_.is_string()) expect("a text");
    return value_.get<std::string>();
  }
  std::optional<std::string> optional_text() const {
    return is_null() ? std::nullopt : std::optional(text());
  }
  std::vector<double> numbers(std::size_t count) const {
    if (!value_.is_array() || value_.size() != count)
      expect("a list of " + std::to_string(count) + " numbers");
    std::vector<double> out;
    for (const Json& item : value_) out.push_back(Reader(item, place_).number());
    return out;
  }
  std::vector<Reader> items() const {
    if (!value_.is_array()) expect("a list");
    std::vector<Reader> out;
    for (const Json& item : value_) out.emplace_back(item, place_);
    return out;
  }
  [[noreturn]] void expect(const std::string& what) const { expect(what, shown()); }
  [[noreturn]] void expect(const std::string& what, const std::string& got) const {
    throw InputError(place_ + " must be " + what + ", got " + got);
  }

 private:
  std::string shown() const {
    if (is_null()) return "nothing";
    if (value_.is_object()) return "an object";
    return value_.is_array() ? std::to_string(value_.size()) + " values" : printable(value_.dump());
  }

  const Json& value_;
  std::string place_;
};

std::optional<Rigid> read_pose(const Reader& T) {
  if (T.is_null()) return {};
  const auto t = T["translation_m"].numbers(3);
  const auto q = T["quaternion_wxyz"].numbers(4);
  const Eigen::Quaterniond rotation(q[0], q[1], q[2], q[3]);
  const double length = rotation.norm();
  if (std::abs(length - 1.0) > 1e-3) T["quaternion_wxyz"].expect("of length 1", shortest(length));
  return Rigid{rotation.normalized().toRotationMatrix(), {t[0], t[1], t[2]}};
}

std::optional<Matrix6d> read_covariance(const Reader& given) {
  if (given.is_null()) return {};
  const auto numbers = given.numbers(21);
  Matrix6d out;
  std::size_t next = 0;
  for (int row = 0; row < 6; ++row)
    for (int column = row; column < 6; ++column)
      out(row, column) = out(column, row) = numbers[next++];
  return out;
}

std::vector<LensEstimate> read_lens(const Reader& given) {
  if (given.is_null()) return {};
  if (!given.json().is_object()) given.expect("an object, a lens number a key");
  std::vector<LensEstimate> out;
  for (const auto& [key, value] : given.json().items())
    out.push_back({key, given[key]["value"].optional_number().value_or(0.0),
                   given[key]["sigma"].optional_number().value_or(0.0)});
  return out;
}

CameraCalibration read_camera(const Reader& listed, const std::string& name) {
  CameraCalibration out;
  out.name = listed["name"].text();
  const Reader camera(listed.json(), name + ": camera " + in_quotes(out.name));
  out.T_world_cam = read_pose(camera["T_world_cam"]);
  out.covariance = read_covariance(camera["covariance"]);
  out.time_offset_s = camera["time_offset_s"].optional_number().value_or(0.0);
  out.sigma_time_offset_s = camera["sigma_time_offset_s"].optional_number();
  out.reprojection_rms_px = camera["reprojection_rms_px"].optional_number().value_or(0.0);
  out.sightings_used =
      static_cast<int>(camera["sightings_used"].optional_number(sightings_count).value_or(0));
  out.sightings_rejected =
      static_cast<int>(camera["sightings_rejected"].optional_number(sightings_count).value_or(0));
  out.lens = read_lens(camera["lens"]);
  return out;
}

CameraId camera_named(const Reader& given, const std::vector<CameraCalibration>& cameras) {
  const auto found = std::ranges::find(cameras, given.text(), &CameraCalibration::name);
  if (found == cameras.end()) given.expect("the name of a camera in this file");
  return static_cast<CameraId>(found - cameras.begin());
}

Eigen::Vector3d read_vector(const Reader& given) {
  const auto numbers = given.numbers(3);
  return {numbers[0], numbers[1], numbers[2]};
}

std::optional<NextThrow> read_next_throw(const Reader& given,
                                         const std::vector<CameraCalibration>& cameras) {
  if (given.is_null()) return {};
  const auto sigma = [&](const char* key) { return given[key].optional_number().value_or(0.0); };
  NextThrow out;
  out.position_world_m = read_vector(given["position_m"]);
  out.velocity_world_mps = read_vector(given["velocity_mps"]);
  for (const Reader& seen_by : given["cameras"].items())
    out.cameras.push_back(camera_named(seen_by, cameras));
  out.camera = camera_named(given["camera"], cameras);
  out.sigma_position_m = sigma("sigma_position_m");
  out.sigma_rotation_rad = sigma("sigma_rotation_rad");
  out.expected_sigma_position_m = sigma("expected_sigma_position_m");
  out.expected_sigma_rotation_rad = sigma("expected_sigma_rotation_rad");
  out.text = given["text"].text();
  return out;
}

ThrowEstimate read_throw(const Reader& listed, const std::string& name,
                         const std::vector<CameraCalibration>& cameras) {
  ThrowEstimate out;
  out.id = listed["id"].text();
  const Reader thrown(listed.json(), name + ": throw " + in_quotes(out.id));
  out.start = HostTime(from_seconds(thrown["start_s"].number(time_s)));
  out.end = HostTime(from_seconds(thrown["end_s"].number(time_s)));
  out.position_world_m = read_vector(thrown["position_m"]);
  out.velocity_world_mps = read_vector(thrown["velocity_mps"]);
  out.reprojection_rms_px = thrown["reprojection_rms_px"].optional_number().value_or(0.0);
  if (thrown["cameras"].is_null()) return out;  // a truth file need not say who saw it
  for (const Reader& seen_by : thrown["cameras"].items())
    out.cameras.push_back(camera_named(seen_by, cameras));
  return out;
}

Verdict read_verdict(const Reader& given) {
  if (given.is_null()) return Verdict::accepted;  // a truth file, or a guess written by hand
  for (const Verdict verdict :
       {Verdict::accepted, Verdict::needs_more_throws, Verdict::unobservable, Verdict::rejected})
    if (to_string(verdict) == given.text()) return verdict;
  given.expect("accepted, needs-more-throws, unobservable or rejected");
}

}  // namespace

Json parse_json(std::string_view text, const std::string& name) {
  try {
    return Json::parse(text);
  } catch (const Json::exception& error) {
    std::string_view what =
        error.what();  // "[json.exception.parse_error.101] parse error at line 1, ..."
    if (const auto end = what.find("] "); end != what.npos) what.remove_prefix(end + 2);
    throw InputError(name + ": not JSON: " + printable(what, 200));
  }
}

Json read_json(const std::filesystem::path& file) {
  return parse_json(read_text_file(file), file.string());
}

namespace {

/// What was found, all but the advice: a guess that was cut by hand need not keep that whole.
Calibration read_found(const Json& document, const std::string& name) {
  if (!document.is_object()) throw InputError(name + ": must be a calibration (a JSON object)");
  const Reader whole(document, name + ":");
  Calibration out;
  out.verdict = read_verdict(whole["verdict"]);
  if (!whole["reasons"].is_null())
    for (const Reader& reason : whole["reasons"].items()) out.reasons.push_back(reason.text());
  // A truth file says drag_per_m at its top, a calibration in its ball.
  out.drag_per_m = whole["ball"]["drag_per_m"].optional_number().value_or(
      whole["drag_per_m"].optional_number().value_or(0.0));
  out.gravity_mps2 = whole["world"]["gravity_mps2"].optional_number().value_or(0.0);
  out.gravity_source = whole["world"]["gravity_source"].optional_text().value_or("");
  out.sigma_drag_per_m = whole["ball"]["sigma_drag_per_m"].optional_number();
  for (const Reader& camera : whole["cameras"].items())
    out.cameras.push_back(read_camera(camera, name));
  if (!whole["throws"].is_null())
    for (const Reader& thrown : whole["throws"].items())
      out.throws.push_back(read_throw(thrown, name, out.cameras));
  return out;
}

void check(double value, const NumberRange& range, const std::string& place) {
  if (!range.holds(value))
    throw InputError(place + " must be " + range.text + ", got " + shortest(value));
}

/// A camera that a guess must hold, and what the estimator can begin with.
const CameraCalibration& guessed(const std::vector<CameraCalibration>& cameras,
                                 const std::string& camera, const std::string& place) {
  const auto found = std::ranges::find(cameras, camera, &CameraCalibration::name);
  if (found == cameras.end())
    throw InputError(place + " is missing; expected every camera of the rig file");
  if (std::ranges::count(cameras, camera, &CameraCalibration::name) > 1)
    throw InputError(place + " stands twice; expected it once");
  if (!found->T_world_cam)
    throw InputError(place + " has no T_world_cam; a guess must say where every camera stands");
  for (const double coordinate : found->T_world_cam->translation)
    check(coordinate, metres, place + " T_world_cam translation_m");
  check(found->time_offset_s, offset_s, place + " time_offset_s");
  return *found;
}

}  // namespace

Calibration to_calibration(const Json& document, const std::string& name) {
  Calibration out = read_found(document, name);
  out.next_throw = read_next_throw(Reader(document, name + ":")["next_throw"], out.cameras);
  return out;
}

Guess to_guess(const Json& document, const RigDescription& rig, const std::string& name) {
  const Calibration calibration = read_found(document, name);
  Guess guess;
  guess.drag_per_m = calibration.drag_per_m;
  check(guess.drag_per_m, drag_per_m, name + ": drag_per_m");
  for (const CameraDescription& camera : rig.cameras) {
    const std::string place = name + ": camera " + in_quotes(camera.name);
    const CameraCalibration& start = guessed(calibration.cameras, camera.name, place);
    guess.T_world_cam.push_back(*start.T_world_cam);
    guess.time_offset_s.push_back(start.time_offset_s);
  }
  return guess;
}

}  // namespace throwcal
