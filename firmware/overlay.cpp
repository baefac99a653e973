// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/overlay.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>
#include <utility>

#include "firmware/input_error.h"

namespace throwcal {
namespace {

/// Blue, green, red; told apart by people who see no red too.
const std::array<cv::Scalar, 6> colours{cv::Scalar(0, 159, 230),   cv::Scalar(233, 180, 86),
                                        cv::Scalar(115, 158, 0),   cv::Scalar(66, 228, 240),
                                        cv::Scalar(167, 121, 204), cv::Scalar(0, 94, 213)};
const cv::Scalar candidate_colour(150, 150, 150), text_colour(255, 255, 255);
constexpr int fraction_bits = 4;                         ///< cv draws to a sixteenth of a pixel
constexpr auto trail = std::chrono::milliseconds(1500);  ///< how long a film shows where it was

cv::Point fine(const Eigen::Vector2d& px) {
  return {cvRound(px.x() * (1 << fraction_bits)), cvRound(px.y() * (1 << fraction_bits))};
}

int fine(double px) { return cvRound(px * (1 << fraction_bits)); }

/// The colour of each flight, in the order in which they began.
std::map<ThrowId, cv::Scalar> colours_of(const std::vector<SightingRow>& rows) {
  std::map<ThrowId, cv::Scalar> out;
  for (const SightingRow& row : rows)
    if (!row.throw_id.empty()) out.emplace(row.throw_id, colours[out.size() % colours.size()]);
  return out;
}

/// One camera's film, frame by frame, with what was found in it.
class Tile {
 public:
  Tile(std::unique_ptr<Camera> camera, CameraId id, const std::vector<SightingRow>& rows,
       std::map<ThrowId, cv::Scalar> flight_colours)
      : camera_(std::move(camera)), colours_(std::move(flight_colours)) {
    for (const SightingRow& row : rows)
      if (row.sighting.camera == id) rows_.push_back(row);
    std::ranges::stable_sort(rows_, {}, [](const auto& row) { return row.sighting.time; });
    const Camera::Format format = camera_->format();
    slot_.resize(3 * static_cast<std::size_t>(format.width_px) * format.height_px);
    camera_->start();
  }

  double frames_per_s() const { return camera_->format().frames_per_s; }
  HostTime time() const { return frame_.row0_mid_exposure; }

  /// The next frame; false at the end. The last frame stays.
  bool next() {
    Frame frame;
    const Camera::Outcome outcome = camera_->next(slot_, frame);
    if (outcome == Camera::Outcome::failed)
      throw InputError("camera \"" + camera_->name() + "\": " + camera_->error());
    if (outcome != Camera::Outcome::frame) return false;
    frame_ = frame;
    const auto seen = [&](HostTime time) {
      return std::ranges::lower_bound(rows_, time, {},
                                      [](const auto& row) { return row.sighting.time; });
    };
    first_ = seen(time()) - rows_.begin();
    end_ = seen(time() + HostClock::duration(1)) - rows_.begin();
    old_ = seen(time() - trail) - rows_.begin();
    return true;
  }

  cv::Mat picture() const {
    const int type = frame_.image.format == PixelFormat::bgr ? CV_8UC3 : CV_8UC1;
    const cv::Mat view(frame_.image.height_px, frame_.image.width_px, type,
                       const_cast<std::uint8_t*>(frame_.image.data), frame_.image.stride_bytes);
    cv::Mat out;
    type == CV_8UC3 ? view.copyTo(out) : cv::cvtColor(view, out, cv::COLOR_GRAY2BGR);
    return out;
  }

  /// This frame as it is shown in a film.
  cv::Mat filmed() const {
    cv::Mat out = picture();
    for (auto i = first_; i < end_; ++i) mark(row(i), out, 2);
    join(old_, end_, out);
    name(out);
    return out;
  }

  /// Adds this frame's balls in flight to a picture of the whole clip.
  void add_balls(cv::Mat& contact) const {
    if (contact.empty()) contact = picture();
    for (auto i = first_; i < end_; ++i) {
      if (row(i).throw_id.empty()) continue;
      const double radius = 1.3 * row(i).sighting.radius_px.value_or(4.0) + 2;
      cv::Mat disc(contact.size(), CV_8U, cv::Scalar(0));
      cv::circle(disc, fine(row(i).sighting.center_px), fine(radius), 255, -1, cv::LINE_8,
                 fraction_bits);
      picture().copyTo(contact, disc);
    }
  }
  /// Marks over that picture.
  void mark_all(cv::Mat& contact) const {
    for (const SightingRow& row : rows_)
      if (row.throw_id.empty())
        cv::circle(contact, fine(row.sighting.center_px), fine(1.0), candidate_colour, -1,
                   cv::LINE_AA, fraction_bits);
    join(0, std::ssize(rows_), contact);
    for (const SightingRow& row : rows_)
      if (!row.throw_id.empty()) mark(row, contact, 1);
    name(contact);
  }

 private:
  const SightingRow& row(std::ptrdiff_t i) const { return rows_[static_cast<std::size_t>(i)]; }
  cv::Scalar colour(const SightingRow& row) const {
    return row.throw_id.empty() ? candidate_colour : colours_.at(row.throw_id);
  }

  void mark(const SightingRow& row, cv::Mat& out, int thickness) const {
    cv::circle(out, fine(row.sighting.center_px), fine(row.sighting.radius_px.value_or(4.0) + 2.5),
               colour(row), row.throw_id.empty() ? 1 : thickness, cv::LINE_AA, fraction_bits);
  }
  /// A line along each flight, and its name where it begins.
  void join(std::ptrdiff_t from, std::ptrdiff_t to, cv::Mat& out) const {
    std::map<ThrowId, const SightingRow*> last;
    for (auto i = from; i < to; ++i) {
      if (row(i).throw_id.empty()) continue;
      const auto [before, is_first] = last.try_emplace(row(i).throw_id, &row(i));
      if (is_first)
        cv::putText(out, row(i).throw_id,
                    cv::Point(cvRound(row(i).sighting.center_px.x()) + 10,
                              cvRound(row(i).sighting.center_px.y()) + 4),
                    cv::FONT_HERSHEY_SIMPLEX, 0.5, colour(row(i)), 1, cv::LINE_AA);
      else
        cv::line(out, fine(before->second->sighting.center_px), fine(row(i).sighting.center_px),
                 colour(row(i)), 1, cv::LINE_AA, fraction_bits);
      before->second = &row(i);
    }
  }
  void name(cv::Mat& out) const {
    const cv::Point place(8, out.rows - 10);
    cv::putText(out, camera_->name(), place, cv::FONT_HERSHEY_SIMPLEX, 0.6, {0, 0, 0}, 3,
                cv::LINE_AA);
    cv::putText(out, camera_->name(), place, cv::FONT_HERSHEY_SIMPLEX, 0.6, text_colour, 1,
                cv::LINE_AA);
  }

  std::unique_ptr<Camera> camera_;
  std::map<ThrowId, cv::Scalar> colours_;
  std::vector<SightingRow> rows_;  ///< this camera's, ordered by time
  std::vector<std::uint8_t> slot_;
  Frame frame_;
  std::ptrdiff_t first_ = 0, end_ = 0, old_ = 0;  ///< rows of the frame; where its trail begins
};

/// Pictures side by side, in as many columns as make the whole about square.
cv::Mat tiled(const std::vector<cv::Mat>& pictures) {
  cv::Size size(0, 0);
  for (const cv::Mat& picture : pictures)
    size = {std::max(size.width, picture.cols), std::max(size.height, picture.rows)};
  const int count = static_cast<int>(pictures.size());
  const int columns = static_cast<int>(std::ceil(std::sqrt(count)));
  cv::Mat out((count + columns - 1) / columns * size.height, columns * size.width, CV_8UC3,
              cv::Scalar(0, 0, 0));
  for (int i = 0; i < count; ++i) {
    const cv::Mat& picture = pictures[static_cast<std::size_t>(i)];
    picture.copyTo(out(
        cv::Rect(i % columns * size.width, i / columns * size.height, picture.cols, picture.rows)));
  }
  return out;
}

void check_written(bool is_written, const std::filesystem::path& file) {
  if (!is_written)
    throw InputError(file.string() +
                     ": can't be written; expected a name in a folder that may be written to, "
                     "ending in .png or .mkv");
}

void draw_picture(const std::filesystem::path& file, std::vector<Tile>& tiles,
                  const std::function<void()>& drawn) {
  std::vector<cv::Mat> pictures;
  for (Tile& tile : tiles) {
    cv::Mat contact;
    for (; tile.next(); drawn()) tile.add_balls(contact);
    tile.mark_all(contact);
    pictures.push_back(contact);
  }
  bool is_written = false;
  try {
    is_written = cv::imwrite(file.string(), tiled(pictures));
  } catch (const cv::Exception&) {  // told below
  }
  check_written(is_written, file);
}

void draw_film(const std::filesystem::path& file, std::vector<Tile>& tiles,
               const std::function<void()>& drawn) {
  cv::VideoWriter film;
  std::vector<cv::Mat> pictures(tiles.size());
  for (std::size_t i = 1; i < tiles.size(); ++i) tiles[i].next();
  for (; tiles.front().next(); drawn()) {
    pictures.front() = tiles.front().filmed();
    for (std::size_t i = 1; i < tiles.size(); ++i) {
      while (tiles[i].time() < tiles.front().time() && tiles[i].next()) continue;
      pictures[i] = tiles[i].filmed();
    }
    const cv::Mat whole = tiled(pictures);
    if (!film.isOpened())
      film.open(file.string(), cv::CAP_FFMPEG, cv::VideoWriter::fourcc('M', 'J', 'P', 'G'),
                std::max(1.0, tiles.front().frames_per_s()), whole.size());
    check_written(film.isOpened(), file);
    film.write(whole);
  }
}

}  // namespace

bool is_overlay_name(const std::filesystem::path& file) {
  return file.extension() == ".png" || file.extension() == ".mkv";
}

void draw_overlay(const std::filesystem::path& file, std::vector<std::unique_ptr<Camera>> cameras,
                  const RigDescription& rig, const std::vector<SightingRow>& rows,
                  const std::function<void()>& drawn) {
  const auto flight_colours = colours_of(rows);
  std::vector<Tile> tiles;
  for (auto& camera : cameras) {
    const auto its = std::ranges::find(rig.cameras, camera->name(), &CameraDescription::name);
    const auto id = static_cast<CameraId>(its - rig.cameras.begin());
    tiles.emplace_back(std::move(camera), id, rows, flight_colours);
  }
  file.extension() == ".png" ? draw_picture(file, tiles, drawn) : draw_film(file, tiles, drawn);
}

}  // namespace throwcal
