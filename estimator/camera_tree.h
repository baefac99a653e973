// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "estimator/camera_matching.h"

namespace throwcal {

/// A first, rough rig out of the matches between two cameras each.
class CameraTree {
 public:
  /// The strongest matches that join `cameras` cameras without a circle. Keys are (a, b), a < b.
  CameraTree(std::size_t cameras,
             const std::map<std::pair<CameraId, CameraId>, CameraMatch>& matches);

  /// How b stands to a along the tree, uncertainties added up; nothing where nothing joins them.
  std::optional<CameraAlignment> between(CameraId a, CameraId b) const;
  /// Group of cameras that are joined; a camera alone is a group of its own.
  std::size_t group(CameraId camera) const { return nodes_[camera].group; }
  /// Clock offset to the group's first camera [s].
  double offset_s(CameraId camera) const { return nodes_[camera].offset_s; }

 private:
  struct Node {
    std::size_t group = 0;
    Rigid T_root_cam;
    double offset_s = 0.0;
    Eigen::Matrix<double, 5, 5> covariance = Eigen::Matrix<double, 5, 5>::Zero();
  };
  void attach(CameraId camera, CameraId parent, const CameraAlignment& parent_to_camera);
  std::vector<Node> nodes_;
};

}  // namespace throwcal
