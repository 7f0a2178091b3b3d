#include "train/camera_refinement.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "nerf/base/error.h"

namespace nerf {

namespace {

constexpr double kBeta1 = 0.9, kBeta2 = 0.99;
// A readout's step as a share of the others': all photos of a lens speak of it, none of them much,
// and it has further to go. With 1 it stays behind on a film of 32 frames: 0.68 of 0.8.
constexpr double kReadoutRate = 3;

// Whether all rays of the camera begin at its centre.
bool has_one_centre(const Camera& camera) { return !is_panorama(camera) || camera.params[4] == 0; }

double dot_of(const std::vector<double>& a, const std::vector<double>& b) {
  double sum = 0;
  for (size_t i = 0; i < a.size(); ++i) sum += a[i] * b[i];
  return sum;
}

}  // namespace

CameraRefinement::CameraRefinement(const Scene& scene, const PhotoSet& photos,
                                   const CameraRecipe& recipe, PixelSource& source,
                                   RollingShutter* shutter)
    : scene_(scene), photos_(photos), recipe_(recipe), source_(source), shutter_(shutter) {
  const bool refines = recipe.refine == RefineCameras::kOn;
  std::vector<int> of_camera = lens_groups(scene);
  std::map<int, int> lenses;  // of those groups that are corrected, their places in order
  for (size_t c = 0; c < scene.cameras.size(); ++c) {
    const bool corrects = refines && recipe.lens && can_correct_lens(scene.cameras[c].model);
    const int next = static_cast<int>(lenses.size());
    of_camera[c] = corrects ? lenses.try_emplace(of_camera[c], next).first->second : -1;
  }
  for (const View& view : scene.views)
    lens_of_view_.push_back(of_camera[static_cast<size_t>(view.camera)]);
  int poses = 0;
  for (size_t i = 0; i < scene.train.size(); ++i) {
    const size_t view = static_cast<size_t>(scene.train[i]);
    given_.push_back(scene.to_engine.apply(scene.views[view].pose));
    const bool moves = refines && has_one_centre(photos.cameras[view]);
    pose_of_.push_back(moves ? source.file_of(i) : -1);
    lens_of_.push_back(lens_of_view_[view]);
    if (refines) poses = std::max(poses, source.file_of(i) + 1);
  }
  pose_factors_.resize(static_cast<size_t>(poses));
  lens_factors_.resize(lenses.size());
  find_factors();
  values_.resize(readouts_at() + readout_scale_.size());
  m_ = v_ = sums_ = values_;
  find_gauge();
}

CameraRefinement::Factor CameraRefinement::factor_of(std::vector<double> sum, int n) {
  constexpr double kPad = 0.1, kLeast = 1e-6;  // of the diagonal; absolute, radians squared
  const size_t size = static_cast<size_t>(n);
  for (size_t i = 0; i < size; ++i) {
    double& d = sum[i * size + i];
    d = d > 0 ? d * (1 + kPad) + kLeast : 1;  // one that changes nothing
  }
  for (size_t i = 0; i < size; ++i)
    for (size_t j = 0; j <= i; ++j) {
      double x = sum[i * size + j];
      for (size_t k = 0; k < j; ++k) x -= sum[i * size + k] * sum[j * size + k];
      sum[i * size + j] = i == j ? std::sqrt(x) : x / sum[j * size + j];
    }
  return {std::move(sum), n};
}

void CameraRefinement::Factor::solve_transposed(double* x) const {
  for (int i = n; i-- > 0;) {
    for (int k = i + 1; k < n; ++k) x[i] -= l[static_cast<size_t>(k * n + i)] * x[k];
    x[i] /= l[static_cast<size_t>(i * n + i)];
  }
}

void CameraRefinement::Factor::solve(double* x) const {
  for (int i = 0; i < n; ++i) {
    for (int k = 0; k < i; ++k) x[i] -= l[static_cast<size_t>(i * n + k)] * x[k];
    x[i] /= l[static_cast<size_t>(i * n + i)];
  }
}

void CameraRefinement::Factor::multiply_transposed(double* x) const {
  for (int i = 0; i < n; ++i) {
    double sum = 0;
    for (int k = i; k < n; ++k) sum += l[static_cast<size_t>(k * n + i)] * x[k];
    x[i] = sum;
  }
}

// From the sparse points that a photo sees; of one that sees hardly any from a lattice of its
// pixels at the distance of the scene's middle.
void CameraRefinement::find_factors() {
  constexpr int kFewest = 24, kLattice = 8;
  std::vector<std::vector<Vec3d>> seen(scene_.views.size());
  for (const Observation& o : scene_.observations) {
    const Vec3d at = scene_.points[static_cast<size_t>(o.point)].position;
    seen[static_cast<size_t>(o.image)].push_back(scene_.to_engine.apply(at));
  }
  between_.assign(pose_factors_.size(), std::vector<double>(kLens * kPose));
  lens_of_pose_.assign(pose_factors_.size(), -1);
  std::vector<std::vector<double>> poses(pose_factors_.size(), std::vector<double>(kPose * kPose));
  std::vector<std::vector<double>> lenses(lens_factors_.size(), std::vector<double>(kLens * kLens));
  std::vector<double> pose_counts(poses.size()), lens_counts(lenses.size());
  std::vector<double> squares(learns_readouts() ? shutter_->readouts().size() : 0);
  std::vector<double> readout_counts(squares.size());
  const auto add = [](const auto& row, const auto& column, std::vector<double>& sum) {
    for (size_t i = 0; i < row.size(); ++i)
      for (size_t j = 0; j < column.size(); ++j) sum[i * column.size() + j] += row[i] * column[j];
  };
  for (size_t i = 0; i < given_.size(); ++i) {
    const size_t view = static_cast<size_t>(scene_.train[i]);
    const Camera& camera = photos_.cameras[view];
    const Pose& pose = given_[i];
    std::vector<Vec3d> points = seen[view];
    if (points.size() < kFewest) {
      const double distance = std::max(length(pose.translation), 0.1);
      for (int y = 0; y < kLattice; ++y)
        for (int x = 0; x < kLattice; ++x)
          if (const auto ray = camera_ray(
                  camera, pose,
                  {(x + 0.5) / kLattice * camera.width, (y + 0.5) / kLattice * camera.height}))
            points.push_back(ray->origin + ray->direction * distance);
    }
    for (const Vec3d& point : points) {
      const Vec3d apart = point - pose.translation;
      const double distance = length(apart);
      if (!(distance > 0)) continue;
      const Vec3d u = apart / distance;
      const Mat3d to_camera = pose.rotation.transposed();
      const size_t p = static_cast<size_t>(pose_of_[i]), l = static_cast<size_t>(lens_of_[i]);
      if (learns_readouts()) {
        const Twist& twist = shutter_->twist(view);
        const Vec3d moved = pose.rotation * twist.translation * scene_.to_engine.scale;
        const Vec3d by =
            cross(pose.rotation * twist.rotation, u) + (moved - u * dot(u, moved)) / distance;
        constexpr double kMeanSquare = 1.0 / 12;  // of a line's share
        squares[shutter_->camera_of(view)] += kMeanSquare * dot(by, by);
        ++readout_counts[shutter_->camera_of(view)];
      }
      for (int k = 0; k < 3; ++k) {
        Vec3d e;
        e[k] = 1;
        // Component k of cross(rotation, u), of (I - u u^T) translation / distance, and of what the
        // lens does.
        const Vec3d turn = cross(u, e), move = (e - u * u[k]) / distance;
        const std::array of_pose{turn.x, turn.y, turn.z, move.x, move.y, move.z};
        std::array<double, kLens> of_lens{};
        if (lens_of_[i] >= 0) of_lens = free_gradient(camera, {}, to_camera * u, to_camera * e);
        if (pose_of_[i] >= 0) add(of_pose, of_pose, poses[p]);
        if (lens_of_[i] >= 0) add(of_lens, of_lens, lenses[l]);
        if (pose_of_[i] >= 0 && lens_of_[i] >= 0) add(of_lens, of_pose, between_[p]);
      }
      if (pose_of_[i] >= 0) ++pose_counts[p];
      if (lens_of_[i] >= 0) ++lens_counts[l];
      if (pose_of_[i] >= 0 && lens_of_[i] >= 0) lens_of_pose_[p] = lens_of_[i];
    }
  }
  // S of a pose is the mean over its points; that of a lens over all its photos', less what their
  // poses make up for (the Schur complement).
  for (size_t p = 0; p < poses.size(); ++p) {
    const double count = std::max(pose_counts[p], 1.0);
    for (double& x : poses[p]) x /= count;
    pose_factors_[p] = factor_of(std::move(poses[p]), kPose);
    for (double& x : between_[p]) x /= count;
    for (size_t k = 0; k < kLens; ++k) pose_factors_[p].solve(between_[p].data() + k * kPose);
    if (lens_of_pose_[p] < 0) continue;
    std::vector<double>& lens = lenses[static_cast<size_t>(lens_of_pose_[p])];
    for (size_t i = 0; i < kLens; ++i)
      for (size_t j = 0; j < kLens; ++j)
        for (size_t k = 0; k < kPose; ++k)
          lens[i * kLens + j] -= count * between_[p][i * kPose + k] * between_[p][j * kPose + k];
  }
  for (size_t l = 0; l < lenses.size(); ++l) {
    for (double& x : lenses[l]) x /= std::max(lens_counts[l], 1.0);
    lens_factors_[l] = factor_of(std::move(lenses[l]), kLens);
  }
  for (size_t r = 0; r < squares.size(); ++r)
    readout_scale_.push_back(
        factor_of({squares[r] / std::max(readout_counts[r], 1.0)}, 1).l.front());
}

void CameraRefinement::find_gauge() {
  Vec3d middle;
  for (const Pose& pose : given_) middle = middle + pose.translation / double(given_.size());
  constexpr int kFreedoms = 7;
  for (int f = 0; f < kFreedoms; ++f) {
    std::vector<double> g(values_.size());
    for (size_t i = 0; i < given_.size(); ++i) {
      if (pose_of_[i] < 0) continue;
      const Vec3d from_middle = given_[i].translation - middle;
      Vec3d turn, move, e;
      if (f < 6) e[f % 3] = 1;
      if (f < 3) {
        move = e;
      } else if (f < 6) {
        turn = e;
        move = cross(e, from_middle);
      } else {
        move = from_middle;
      }
      double* const x = g.data() + kPose * pose_of_[i];
      for (int k = 0; k < 3; ++k) {
        x[k] = turn[k];
        x[3 + k] = move[k];
      }
    }
    for (size_t p = 0; p < pose_factors_.size(); ++p)
      pose_factors_[p].multiply_transposed(g.data() + kPose * p);
    const double before = std::sqrt(dot_of(g, g));
    for (const std::vector<double>& other : gauge_) {
      const double along = dot_of(g, other);
      for (size_t i = 0; i < g.size(); ++i) g[i] -= along * other[i];
    }
    const double after = std::sqrt(dot_of(g, g));
    // Cameras in one place have no scale.
    if (!(after > 1e-6 * before)) continue;
    for (double& x : g) x /= after;
    gauge_.push_back(std::move(g));
  }
}

PoseCorrection CameraRefinement::pose_correction(size_t pose) const {
  double x[kPose];
  std::copy_n(values_.data() + kPose * pose, kPose, x);
  if (const int lens = lens_of_pose_[pose]; lens >= 0) {
    double of_lens[kLens];
    std::copy_n(lens_values(static_cast<size_t>(lens)), kLens, of_lens);
    lens_factors_[static_cast<size_t>(lens)].solve_transposed(of_lens);
    for (size_t i = 0; i < kLens; ++i)
      for (size_t k = 0; k < kPose; ++k) x[k] -= between_[pose][i * kPose + k] * of_lens[i];
  }
  pose_factors_[pose].solve_transposed(x);
  return {{x[0], x[1], x[2]}, {x[3], x[4], x[5]}};
}

LensCorrection CameraRefinement::lens_correction(size_t lens) const {
  double x[kLens];
  std::copy_n(lens_values(lens), kLens, x);
  lens_factors_[lens].solve_transposed(x);
  return {x[0], {x[1], x[2]}, x[3], x[4]};
}

// Of what is refined of a lens. A principal point and rotations of all its photos do nearly the
// same.
std::array<double, LensCorrection::kParameters> CameraRefinement::free_gradient(
    const Camera& refined, const LensCorrection& correction, const Vec3d& direction,
    const Vec3d& gradient) const {
  auto out = lens_gradient(refined, correction, direction, gradient);
  if (!recipe_.centre) out[1] = out[2] = 0;
  return out;
}

// A readout r gives a line's pose the factor exp(share r twist), whose derivative by r is itself
// times share twist: the line turns and moves by share twist, in its own axes.
void CameraRefinement::find_gradient(const Pose& pose, double share, const Vec3d& direction,
                                     const Vec3d& gradient, RayMove& move) const {
  const size_t i = static_cast<size_t>(move.source);
  if (learns_readouts()) {
    const Twist& twist = shutter_->twist(static_cast<size_t>(scene_.train[i]));
    move.readout =
        share * (dot(pose.rotation * twist.rotation, move.torque) +
                 dot(pose.rotation * twist.translation, move.origin) * scene_.to_engine.scale);
  }
  if (shutter_)
    move.torque =
        move.torque + cross(pose.translation - source_.pose_of(i).translation, move.origin);
  if (lens_of_[i] < 0) return;
  const Mat3d to_camera = pose.rotation.transposed();
  move.lens = free_gradient(source_.camera_of(i), lens_correction(static_cast<size_t>(lens_of_[i])),
                            to_camera * direction, to_camera * gradient);
}

void CameraRefinement::add(std::span<const RayMove> moves) {
  for (const RayMove& move : moves) {
    if (move.source < 0) continue;
    const size_t i = static_cast<size_t>(move.source);
    if (pose_of_[i] >= 0) {
      double* const sum = sums_.data() + kPose * pose_of_[i];
      for (int k = 0; k < 3; ++k) {
        sum[k] += move.torque[k];
        sum[3 + k] += move.origin[k];
      }
    }
    if (lens_of_[i] >= 0) {
      double* const sum =
          sums_.data() + kPose * pose_factors_.size() + static_cast<size_t>(kLens * lens_of_[i]);
      for (size_t k = 0; k < kLens; ++k) sum[k] += move.lens[k];
    }
    if (learns_readouts())
      sums_[readouts_at() + shutter_->camera_of(static_cast<size_t>(scene_.train[i]))] +=
          move.readout;
  }
  ++counts_[1];
}

std::vector<double> CameraRefinement::gradient() const {
  std::vector<double> g = sums_;
  for (double& x : g) x /= static_cast<double>(std::max<int64_t>(counts_[1], 1));
  for (size_t p = 0; p < pose_factors_.size(); ++p) {
    double* const x = g.data() + kPose * p;
    const Vec3d turn = rotation_gradient(pose_correction(p).rotation, {x[0], x[1], x[2]});
    for (int k = 0; k < 3; ++k) x[k] = turn[k];
    pose_factors_[p].solve(x);
    if (lens_of_pose_[p] < 0) continue;
    double* const of_lens = lens_part(g, static_cast<size_t>(lens_of_pose_[p]));
    for (size_t i = 0; i < kLens; ++i)
      for (size_t k = 0; k < kPose; ++k) of_lens[i] -= between_[p][i * kPose + k] * x[k];
  }
  for (size_t l = 0; l < lens_factors_.size(); ++l) lens_factors_[l].solve(lens_part(g, l));
  for (size_t r = 0; r < readout_scale_.size(); ++r) {
    const double readout = values_[readouts_at() + r] / readout_scale_[r];
    double& x = g[readouts_at() + r];
    x = (x + 2 * kReadoutPrior * readout) / readout_scale_[r];
  }
  const double prior = 2 * recipe_.prior / static_cast<double>(std::max<size_t>(g.size(), 1));
  for (size_t i = 0; i < g.size(); ++i) g[i] += prior * values_[i];
  return g;
}

void CameraRefinement::update(double rate) {
  if (counts_[1] < recipe_.steps) return;
  const std::vector<double> g = gradient();
  std::ranges::fill(sums_, 0.0);
  counts_[1] = 0;
  const double t = static_cast<double>(++counts_[0]);
  const double first = 1 - std::pow(kBeta1, t), second = 1 - std::pow(kBeta2, t);
  std::vector<double> step(g.size());
  for (size_t i = 0; i < g.size(); ++i) {
    m_[i] += (1 - kBeta1) * (g[i] - m_[i]);
    v_[i] += (1 - kBeta2) * (g[i] * g[i] - v_[i]);
    const double root = std::sqrt(v_[i] / second);
    step[i] = root > 0 ? rate * (m_[i] / first) / root : 0;
  }
  for (size_t i = readouts_at(); i < step.size(); ++i) step[i] *= kReadoutRate;
  for (const std::vector<double>& along : gauge_) {
    const double share = dot_of(along, step);
    for (size_t i = 0; i < step.size(); ++i) step[i] -= share * along[i];
  }
  for (size_t i = 0; i < step.size(); ++i) values_[i] -= step[i];
  for (size_t r = 0; r < readout_scale_.size(); ++r) {
    const double most = kMostReadout * readout_scale_[r];
    double& x = values_[readouts_at() + r];
    x = std::clamp(x, -most, most);
  }
  apply();
}

void CameraRefinement::apply() {
  for (size_t i = 0; i < given_.size(); ++i) {
    const Camera& given = photos_.cameras[static_cast<size_t>(scene_.train[i])];
    const Pose pose = pose_of_[i] < 0
                          ? given_[i]
                          : corrected(given_[i], pose_correction(static_cast<size_t>(pose_of_[i])));
    source_.place(i, pose,
                  lens_of_[i] < 0
                      ? given
                      : corrected(given, lens_correction(static_cast<size_t>(lens_of_[i]))));
  }
  for (size_t r = 0; r < readout_scale_.size(); ++r)
    shutter_->set_readout(r, values_[readouts_at() + r] / readout_scale_[r]);
  if (shutter_) shutter_->place(source_);
}

void CameraRefinement::set_values(std::span<const double> values) {
  NERF_CHECK_EQ(values.size(), values_.size());
  std::ranges::copy(values, values_.begin());
  apply();
}

void CameraRefinement::reset() {
  for (auto* a : {&values_, &m_, &v_, &sums_}) std::ranges::fill(*a, 0.0);
  std::ranges::fill(counts_, int64_t{0});
  apply();
}

Pose CameraRefinement::pose(size_t view) const {
  for (size_t i = 0; i < scene_.train.size(); ++i)
    if (static_cast<size_t>(scene_.train[i]) == view && pose_of_[i] >= 0)
      return scene_.to_engine.apply_inverse(source_.pose_of(i));
  return scene_.views[view].pose;
}

Camera CameraRefinement::camera(size_t view) const {
  const int lens = lens_of_view_[view];
  const Camera& given = photos_.cameras[view];
  return lens < 0 ? given : corrected(given, lens_correction(static_cast<size_t>(lens)));
}

}  // namespace nerf
