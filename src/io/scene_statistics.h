// Statistics over cameras and points that a few bad ones among them do not move.
#pragma once

#include <utility>
#include <vector>

#include "nerf/io/scene.h"

namespace nerf::internal {

// Value at a fraction of the sorted list. 0 for an empty one.
double quantile(std::vector<double> values, double fraction);

// The median of each coordinate by itself.
Vec3d median_position(const std::vector<Vec3d>& positions);

// Which values belong to the crowd: at most `factor` times the quantile at 0.8, so that no fifth of
// them can change it. All do where the quantile is 0. Values are not negative.
std::vector<char> in_the_crowd(const std::vector<double>& values, double factor);

// Where content begins and ends, engine units, of an unbounded scene whose points lie at these
// distances from the cameras that see them; at least 1.
std::pair<double, double> near_far_of(const std::vector<double>& distances);

// Sets the scene's by such distances, where no option says them.
void set_near_far(const std::vector<double>& distances, Scene& scene);

// Points that several images agree on: what normalisation may rely on. Three images, or two where a
// capture has few that three see; all where nobody knows who sees them.
std::vector<char> supported_points(const std::vector<ScenePoint>& points);

}  // namespace nerf::internal
