#include "camera_orbit.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <numbers>

#include "nerf/base/error.h"

namespace nerf::internal {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kDegree = kPi / 180;
constexpr Vec3d kUp{0, 0, 1};

// Cameras with a gap this wide between their azimuths do not stand all the way round.
constexpr double kWidestGap = 90 * kDegree;
// Half the arc of a swing where a camera or two say nothing of one.
constexpr double kLeastSwing = 8 * kDegree;
constexpr double kAstray = 3;                    // times the median distance, or one over it
constexpr double kNeighbourhood = 20 * kDegree;  // sigma of the weight of a camera's azimuth
constexpr double kMostElevation = 75 * kDegree;  // an orbit straight above would turn on the spot
// The azimuth of a camera above the focus says nothing; that of one at it neither.
constexpr double kLeastRadius = 0.05;  // of the distance

// How the camera gives way to matter.
constexpr int kPlaces = 96;  // along the curve
constexpr std::array kScales{1.0, 0.93, 0.86, 0.79, 0.72, 0.64, 0.56, 0.48, 0.4, 1.08};
constexpr std::array kLifts{0.0, 8.0, -8.0, 16.0, -16.0, 24.0};  // of the elevation, degrees
constexpr int kCandidates = static_cast<int>(kScales.size() * kLifts.size());
constexpr double kClearance = 0.05;   // of the distance: free space around the camera
constexpr double kForeground = 0.35;  // of the distance, before the lens: free on the whole
constexpr int kAhead = 14;            // samples of the foreground
constexpr double kObstacle = 0.25;    // share of the light stopped that counts as obstruction

double horizontal(const Vec3d& v) { return std::hypot(v.x, v.y); }

// What the photos say of distance and height at an azimuth.
class Rounds {
 public:
  explicit Rounds(const OrbitInput& input) : focus_(input.focus), outward_(input.outward) {
    std::vector<double> distances;
    for (const Pose& c : input.cameras) distances.push_back(length(c.translation - focus_));
    typical_ = quantile(distances, 0.5);
    if (!(typical_ > 1e-9)) typical_ = 1;
    std::vector<double> azimuths;
    for (const Pose& c : input.cameras) {
      const Vec3d from = c.translation - focus_;
      const double distance = length(from);
      if (distance > kAstray * typical_ || kAstray * distance < typical_) continue;
      Stand stand;
      stand.distance = distance;
      stand.elevation = std::clamp(std::asin(std::clamp(from.z / distance, -1.0, 1.0)),
                                   -kMostElevation, kMostElevation);
      stand.has_azimuth = horizontal(from) > kLeastRadius * distance;
      stand.azimuth = std::atan2(from.y, from.x);
      if (stand.has_azimuth) azimuths.push_back(stand.azimuth);
      stands_.push_back(stand);
    }
    if (stands_.empty()) stands_.push_back({typical_, 0, 0, false});
    arc_ = covered_arc(azimuths, kWidestGap);
    if (!arc_.full && azimuths.size() < 3) arc_.half_width = std::max(arc_.half_width, kLeastSwing);
    if (!arc_.full) sway_ = spread_of_elevations();
  }

  const Arc& arc() const { return arc_; }
  double typical_distance() const { return typical_; }
  double azimuth(double u) const {
    return arc_.full ? arc_.middle + 2 * kPi * u
                     : arc_.middle + arc_.half_width * std::sin(2 * kPi * u);
  }
  Vec3d position(double u, double scale, double lift) const {
    const double a = azimuth(u);
    const auto [distance, mean_elevation] = mean_at(a);
    const double sway = sway_ * std::cos(2 * kPi * u);
    const double e = std::clamp(mean_elevation + sway + lift, -kMostElevation, kMostElevation);
    const double d = scale * distance;
    return focus_ +
           Vec3d{d * std::cos(e) * std::cos(a), d * std::cos(e) * std::sin(a), d * std::sin(e)};
  }
  // Unit vector from a place on the curve to what it shows.
  Vec3d view_from(const Vec3d& position) const {
    const Vec3d ray = outward_ ? position - focus_ : focus_ - position;
    return length(ray) > 0 ? normalized(ray) : Vec3d{1, 0, 0};
  }

 private:
  struct Stand {
    double distance = 1, elevation = 0, azimuth = 0;
    bool has_azimuth = false;
  };

  std::pair<double, double> mean_at(double azimuth) const {
    constexpr double kFar = 1e-4;  // weight of those on the other side
    constexpr double kappa = 1 / (kNeighbourhood * kNeighbourhood);
    double distance = 0, elevation = 0, total = 0;
    for (const Stand& s : stands_) {
      const double w =
          s.has_azimuth ? kFar + std::exp(kappa * (std::cos(azimuth - s.azimuth) - 1)) : kFar;
      distance += w * s.distance;
      elevation += w * s.elevation;
      total += w;
    }
    return {distance / total, elevation / total};
  }

  double spread_of_elevations() const {
    double square = 0;
    for (const Stand& s : stands_) {
      const double off = s.elevation - mean_at(s.azimuth).second;
      square += off * off / static_cast<double>(stands_.size());
    }
    return std::sqrt(square);
  }

  Vec3d focus_;
  bool outward_;
  double typical_ = 1, sway_ = 0;
  std::vector<Stand> stands_;
  Arc arc_;
};

// Of every place and candidate how much light is stopped around the camera and right before it, in
// [0, 1].
std::vector<double> obstruction(const Rounds& rounds, const OrbitInput& input) {
  const double clearance = kClearance * rounds.typical_distance();
  const double step = kForeground * rounds.typical_distance() / kAhead;
  std::vector<Vec3d> around{{0, 0, 0}};
  for (const double s : {-1.0, 1.0}) {
    around.insert(around.end(), {{s, 0, 0}, {0, s, 0}, {0, 0, s}});
    for (const double t : {-0.577, 0.577})
      around.insert(around.end(), {{0.577 * s, t, 0.577}, {0.577 * s, t, -0.577}});
  }
  std::vector<Vec3d> points;
  for (int place = 0; place < kPlaces; ++place)
    for (const double scale : kScales)
      for (const double lift : kLifts) {
        const Vec3d p =
            rounds.position(static_cast<double>(place) / kPlaces, scale, lift * kDegree);
        for (const Vec3d& offset : around) points.push_back(p + offset * clearance);
        const Vec3d view = rounds.view_from(p);
        for (int i = 0; i < kAhead; ++i) points.push_back(p + view * (step * (i + 0.5)));
      }
  const std::vector<double> density = input.density(points);
  NERF_CHECK_EQ(density.size(), points.size());
  std::vector<double> stopped;
  for (auto at = density.begin(); at != density.end();) {
    double near = 0, ahead = 0;
    for (size_t i = 0; i < around.size(); ++i) near = std::max(near, *at++ * clearance);
    for (int i = 0; i < kAhead; ++i) ahead += *at++ * step;
    stopped.push_back(1 - std::exp(-std::max(near, ahead)));
  }
  return stopped;
}

double squared(double x) { return x * x; }

// The candidate of each place that together cost least: of obstruction, of leaving the photos'
// round, and of moving from place to place. Of the closed curve, by going round it twice.
std::vector<int> best_way(const std::vector<double>& stopped) {
  constexpr double kObstruction = 20, kLeaving = 1, kMoving = 40;
  std::vector<double> scale, lift;
  for (const double s : kScales)
    for (const double l : kLifts) {
      scale.push_back(s);
      lift.push_back(l / 60);  // a sixth of a turn counts as much as the whole distance
    }
  constexpr int kSteps = 2 * kPlaces;
  std::vector<double> cost(kCandidates, 0), next(kCandidates);
  std::vector<std::array<int, kCandidates>> from(kSteps);
  for (int step = 0; step < kSteps; ++step) {
    for (int c = 0; c < kCandidates; ++c) {
      double least = 1e300;
      for (int b = 0; b < kCandidates; ++b) {
        const double moved = squared(scale[c] - scale[b]) + squared(lift[c] - lift[b]);
        const double sum = cost[b] + kMoving * moved;
        if (sum >= least) continue;
        least = sum;
        from[step][c] = b;
      }
      const double light = stopped[static_cast<size_t>(step % kPlaces * kCandidates + c)];
      next[c] = least + kObstruction * squared(light) +
                kLeaving * (squared(scale[c] - 1) + squared(lift[c]));
    }
    cost.swap(next);
  }
  int c = static_cast<int>(std::min_element(cost.begin(), cost.end()) - cost.begin());
  std::vector<int> way(kPlaces);
  // The second half of the first round and the first of the second are far from both ends.
  for (int step = kSteps - 1; step >= 0; --step) {
    if (step >= kPlaces / 2 && step < kPlaces / 2 + kPlaces) way[step % kPlaces] = c;
    c = from[step][c];
  }
  return way;
}

// A periodic table, smoothed, and read by Catmull-Rom.
class Periodic {
 public:
  explicit Periodic(const std::vector<double>& values) {
    constexpr int kReach = 6;
    constexpr double kSigma = 2.5;
    const int n = static_cast<int>(values.size());
    for (int i = 0; i < n; ++i) {
      double sum = 0, total = 0;
      for (int k = -kReach; k <= kReach; ++k) {
        const double w = std::exp(-0.5 * squared(k / kSigma));
        sum += w * values[static_cast<size_t>((i + k + n) % n)];
        total += w;
      }
      values_.push_back(sum / total);
    }
  }
  double at(double u) const {
    const auto n = static_cast<double>(values_.size());
    const double place = (u - std::floor(u)) * n;
    const double t = place - std::floor(place);
    const auto value = [&](int k) {
      const int count = static_cast<int>(values_.size());
      return values_[static_cast<size_t>((static_cast<int>(place) + k + count) % count)];
    };
    const double p0 = value(-1), p1 = value(0), p2 = value(1), p3 = value(2);
    return p1 + 0.5 * t *
                    (p2 - p0 + t * (2 * p0 - 5 * p1 + 4 * p2 - p3 + t * (3 * (p1 - p2) + p3 - p0)));
  }

 private:
  std::vector<double> values_;
};

}  // namespace

PoseCurve make_orbit(const OrbitInput& input, std::vector<std::string>& notes) {
  NERF_CHECK(!input.cameras.empty());
  const auto rounds = std::make_shared<Rounds>(input);
  if (!rounds->arc().full)
    notes.emplace_back(
        "the cameras stand on one side: the orbit swings along the arc that they cover");
  std::vector<double> scale(kPlaces, 1.0), lift(kPlaces, 0.0);
  if (input.density) {
    const std::vector<double> stopped = obstruction(*rounds, input);
    bool obstructed = false;
    for (int place = 0; place < kPlaces; ++place)
      obstructed |= stopped[static_cast<size_t>(place * kCandidates)] > kObstacle;
    if (obstructed) {
      const std::vector<int> way = best_way(stopped);
      for (int place = 0; place < kPlaces; ++place) {
        scale[place] = kScales[static_cast<size_t>(way[place]) / kLifts.size()];
        lift[place] = kLifts[static_cast<size_t>(way[place]) % kLifts.size()] * kDegree;
      }
      if (std::any_of(way.begin(), way.end(), [](int c) { return c != 0; }))
        notes.emplace_back("the orbit gives way where matter stands in it");
    }
  }
  return {[rounds, scales = Periodic(scale), lifts = Periodic(lift)](double u) {
            const Vec3d p = rounds->position(u, scales.at(u), lifts.at(u));
            return Pose{look_rotation(rounds->view_from(p), kUp), p};
          },
          0};
}

}  // namespace nerf::internal
