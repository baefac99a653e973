// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/camera_tree.h"

#include <algorithm>

namespace throwcal {
namespace {

/// b to a turned round: a to b.
CameraAlignment reversed(const CameraAlignment& alignment) {
  CameraAlignment out = alignment;
  out.T_a_b = alignment.T_a_b.inverse();
  out.offset_b_minus_a_s = -alignment.offset_b_minus_a_s;
  return out;
}

}  // namespace

CameraTree::CameraTree(std::size_t cameras,
                       const std::map<std::pair<CameraId, CameraId>, CameraMatch>& matches)
    : nodes_(cameras) {
  // Prim's way from each camera not reached yet: always the strongest match that adds a camera.
  std::vector<bool> reached(cameras, false);
  for (CameraId root = 0; root < cameras; ++root) {
    if (reached[root]) continue;
    reached[root] = true;
    nodes_[root].group = root;
    while (true) {
      const CameraMatch* strongest = nullptr;
      std::pair<CameraId, CameraId> edge;
      for (const auto& [key, match] : matches) {
        if (reached[key.first] == reached[key.second]) continue;
        const CameraId inside = reached[key.first] ? key.first : key.second;
        if (nodes_[inside].group != root) continue;
        if (strongest && match.score <= strongest->score) continue;
        strongest = &match;
        edge = key;
      }
      if (!strongest) break;
      if (reached[edge.first])
        attach(edge.second, edge.first, strongest->alignment);
      else
        attach(edge.first, edge.second, reversed(strongest->alignment));
      reached[edge.first] = reached[edge.second] = true;
    }
  }
}

void CameraTree::attach(CameraId camera, CameraId parent, const CameraAlignment& alignment) {
  const Node& above = nodes_[parent];
  nodes_[camera] = {above.group, above.T_root_cam * alignment.T_a_b,
                    above.offset_s + alignment.offset_b_minus_a_s,
                    above.covariance + alignment.covariance};
}

std::optional<CameraAlignment> CameraTree::between(CameraId a, CameraId b) const {
  if (nodes_[a].group != nodes_[b].group) return std::nullopt;
  CameraAlignment out;
  out.T_a_b = nodes_[a].T_root_cam.inverse() * nodes_[b].T_root_cam;
  out.offset_b_minus_a_s = nodes_[b].offset_s - nodes_[a].offset_s;
  out.covariance = nodes_[a].covariance + nodes_[b].covariance;
  return out;
}

}  // namespace throwcal
