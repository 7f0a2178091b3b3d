#include "gltf_animation.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <set>
#include <tuple>

#include "colmap.h"
#include "gltf_document.h"
#include "nerf/base/error.h"
#include "nerf/base/nearest_name.h"

namespace nerf::internal {

namespace {

namespace fs = std::filesystem;

constexpr size_t kMostNumbers = 50'000'000;  // of all curves: samplers may share an accessor

std::optional<KeyPath> path_named(const std::string& name) {
  if (name == "translation") return KeyPath::kMove;
  if (name == "rotation") return KeyPath::kTurn;
  if (name == "scale") return KeyPath::kScale;
  if (name == "weights") return KeyPath::kWeights;
  return std::nullopt;  // an extension's
}

std::string name_of(const tinygltf::Animation& animation, size_t index) {
  return animation.name.empty() ? fmt::format("{}", index) : printable(animation.name);
}

class CurveReader {
 public:
  CurveReader(const tinygltf::Model& model, const fs::path& path) : model_(model), path_(path) {}

  // targets: of a curve of weights.
  KeyCurve read(const tinygltf::AnimationSampler& sampler, KeyPath path, size_t targets,
                std::string what) {
    what_ = std::move(what);
    std::vector<double> times = read_times(sampler.input);
    const KeyCurve::Shape shape = shape_of(sampler.interpolation);
    const GltfNumbers output(model_, sampler.output, what_ + ", output", path_);
    const size_t width = path == KeyPath::kTurn ? 4 : path == KeyPath::kWeights ? targets : 3;
    const size_t components = path == KeyPath::kWeights ? 1 : width;
    if (static_cast<size_t>(output.components()) != components)
      fail(fmt::format("output has vectors of {} numbers, not of {}", output.components(),
                       components));
    if (output.integers() && !output.normalised())
      fail("output holds whole numbers that are not normalised");
    const size_t parts = shape == KeyCurve::Shape::kCubic ? 3 : 1;
    const size_t expected = times.size() * parts * (width / components);
    if (output.count() != expected)
      fail(fmt::format("output has {} elements for {} keys, and {} are due", output.count(),
                       times.size(), expected));
    count(expected * components);
    std::vector<double> values;
    values.reserve(expected * components);
    for (size_t i = 0; i < output.count(); ++i)
      for (int k = 0; k < output.components(); ++k) {
        values.push_back(output.number(i, k));
        if (!(std::fabs(values.back()) < kFarthestGltf))
          fail(fmt::format("output {} is not finite", i));
      }
    if (path == KeyPath::kTurn) make_unit(values, parts);
    return {std::move(times), std::move(values), shape, path == KeyPath::kTurn};
  }

 private:
  [[noreturn]] void fail(const std::string& problem) const {
    throw Error(what_ + ": " + problem, path_.string(),
                "export the file again, animations sampled");
  }
  void count(size_t numbers) {
    numbers_ += numbers;
    if (numbers_ > kMostNumbers) fail("more keys than an animation can have here");
  }

  std::vector<double> read_times(int accessor) {
    if (accessor < 0) fail("has no input: there are no times of its keys");
    const GltfNumbers input(model_, accessor, what_ + ", input", path_);
    if (input.integers() || input.components() != 1) fail("input is no list of seconds");
    count(input.count());
    std::vector<double> times;
    for (size_t i = 0; i < input.count(); ++i) {
      times.push_back(input.number(i, 0));
      if (!(std::fabs(times.back()) < 1e9)) fail(fmt::format("time {} is not finite", i));
      if (i > 0 && !(times[i] > times[i - 1]))
        fail(fmt::format("times do not rise: {:g} follows {:g}", times[i], times[i - 1]));
    }
    return times;
  }

  KeyCurve::Shape shape_of(const std::string& name) const {
    if (name.empty() || name == "LINEAR") return KeyCurve::Shape::kLinear;
    if (name == "STEP") return KeyCurve::Shape::kStep;
    if (name == "CUBICSPLINE") return KeyCurve::Shape::kCubic;
    fail("unknown interpolation '" + printable(name) + "'");
  }

  void make_unit(std::vector<double>& values, size_t parts) const {
    const size_t middle = parts == 3 ? 4 : 0;
    for (size_t i = middle; i < values.size(); i += 4 * parts) {
      const std::span<double> q(values.data() + i, 4);
      const double norm = quaternion_norm(q);
      if (!(norm > 1e-6)) fail(fmt::format("key {} has a rotation that is none", i / (4 * parts)));
      // Slopes stay as they are: quaternions in files are rounded, not scaled.
      for (double& x : q) x /= norm;
    }
  }

  const tinygltf::Model& model_;
  const fs::path& path_;
  std::string what_;
  size_t numbers_ = 0;
};

}  // namespace

KeyCurve::KeyCurve(std::vector<double> times, std::vector<double> values, Shape shape, bool turns)
    : times_(std::move(times)),
      values_(std::move(values)),
      shape_(shape),
      turns_(turns),
      parts_(shape == Shape::kCubic ? 3 : 1) {
  width_ = values_.size() / (times_.size() * parts_);
}

std::span<const double> KeyCurve::key(size_t i, size_t part) const {
  return std::span(values_).subspan((i * parts_ + part) * width_, width_);
}

void KeyCurve::at(double seconds, std::span<double> out) const {
  const size_t middle = parts_ / 2;
  const auto after = std::upper_bound(times_.begin(), times_.end(), seconds);
  const size_t next = static_cast<size_t>(after - times_.begin());
  const size_t i = next == 0 ? 0 : next - 1;
  const auto from = key(i, middle);
  std::copy(from.begin(), from.end(), out.begin());
  if (next == 0 || next == times_.size() || shape_ == Shape::kStep) return;
  const double span = times_[next] - times_[i], u = (seconds - times_[i]) / span;
  const auto to = key(next, middle);
  if (shape_ == Shape::kCubic) {
    // Appendix C of glTF 2.0.
    const auto leaving = key(i, 2), arriving = key(next, 0);
    const double u2 = u * u, u3 = u2 * u;
    for (size_t k = 0; k < width_; ++k)
      out[k] = (2 * u3 - 3 * u2 + 1) * from[k] + span * (u3 - 2 * u2 + u) * leaving[k] +
               (3 * u2 - 2 * u3) * to[k] + span * (u3 - u2) * arriving[k];
    if (!turns_) return;
    const double norm = quaternion_norm(out);
    for (size_t k = 0; k < 4; ++k) out[k] = norm > 1e-9 ? out[k] / norm : from[k];
  } else if (turns_) {
    const Quaternion q =
        slerp({from[3], from[0], from[1], from[2]}, {to[3], to[0], to[1], to[2]}, u);
    const double turned[4] = {q.x, q.y, q.z, q.w};
    std::copy(turned, turned + 4, out.begin());
  } else {
    for (size_t k = 0; k < width_; ++k) out[k] = from[k] + (to[k] - from[k]) * u;
  }
}

GltfAnimation::GltfAnimation(const tinygltf::Model& model, const GltfNodes& nodes,
                             const Choice& choice, const fs::path& path) {
  const auto fail = [&](const std::string& what) {
    throw Error(what, path.string(), "export the file again, animations sampled");
  };
  CurveReader reader(model, path);
  std::set<std::pair<int, KeyPath>> driven;
  std::map<std::tuple<size_t, int, KeyPath, size_t>, size_t> known;
  std::vector<std::string> names;
  bool found = choice.name.empty();
  for (size_t a = 0; a < model.animations.size(); ++a) {
    const tinygltf::Animation& animation = model.animations[a];
    const std::string name = name_of(animation, a);
    names.push_back(name);
    std::vector<const tinygltf::AnimationChannel*> counting;
    bool free = true;
    for (const auto& channel : animation.channels) {
      const auto target = path_named(channel.target_path);
      const int node = channel.target_node;
      if (!target || node == -1) continue;
      if (node < 0 || static_cast<size_t>(node) >= nodes.size())
        fail(fmt::format("animation {} drives node {}, which there is not", name, node));
      if (!choice.nodes[static_cast<size_t>(node)]) continue;
      if (*target == KeyPath::kWeights && choice.morph_targets.empty()) continue;
      counting.push_back(&channel);
      free = free && !driven.contains({node, *target});
    }
    const bool named = !choice.name.empty() && name == printable(choice.name) && !found;
    found = found || named;
    if (counting.empty()) continue;
    if (choice.name.empty() ? !free : !named) {
      others_.push_back(name);
      continue;
    }
    for (const auto* channel : counting) {
      const KeyPath target = *path_named(channel->target_path);
      const size_t node = static_cast<size_t>(channel->target_node);
      const std::string what = fmt::format("animation {}, sampler {}", name, channel->sampler);
      if (channel->sampler < 0 ||
          static_cast<size_t>(channel->sampler) >= animation.samplers.size())
        fail(what + ": there is no such sampler");
      if (!driven.insert({channel->target_node, target}).second)
        fail(fmt::format("animation {} drives node {} twice", name, node));
      const size_t targets = target == KeyPath::kWeights ? choice.morph_targets[node] : 0;
      if (target == KeyPath::kWeights && targets == 0)
        fail(fmt::format("{} drives weights of node {}, which has no morph targets", what, node));
      if (target != KeyPath::kWeights && nodes.rest()[node].matrix)
        fail(fmt::format("{} drives node {}, which has a matrix", what, node));
      const auto [place, is_new] =
          known.try_emplace({a, channel->sampler, target, targets}, curves_.size());
      if (is_new)
        curves_.push_back(reader.read(animation.samplers[static_cast<size_t>(channel->sampler)],
                                      target, targets, what));
      channels_.push_back({node, place->second, target});
    }
  }
  if (!found)
    throw Error("there is no animation '" + printable(choice.name) + "'", path.string(),
                names.empty() ? "there is none at all" : nearest_name_hint(choice.name, names));
}

double GltfAnimation::first() const {
  double first = curves_.front().times().front();
  for (const KeyCurve& c : curves_) first = std::min(first, c.times().front());
  return first;
}

double GltfAnimation::last() const {
  double last = curves_.front().times().back();
  for (const KeyCurve& c : curves_) last = std::max(last, c.times().back());
  return last;
}

void GltfAnimation::pose(double seconds, std::vector<NodePose>& poses) const {
  for (const Channel& channel : channels_) {
    const KeyCurve& curve = curves_[channel.curve];
    NodePose& pose = poses[channel.node];
    std::vector<double> x(curve.width());
    curve.at(seconds, x);
    switch (channel.path) {
      case KeyPath::kMove:
        pose.move = {x[0], x[1], x[2]};
        break;
      case KeyPath::kTurn:
        pose.turn = {x[3], x[0], x[1], x[2]};
        break;
      case KeyPath::kScale:
        pose.scale = {x[0], x[1], x[2]};
        break;
      case KeyPath::kWeights:
        pose.weights = std::move(x);
        break;
    }
  }
}

std::vector<char> driven_nodes(const tinygltf::Model& model) {
  std::vector<char> driven(model.nodes.size());
  for (const tinygltf::Animation& animation : model.animations)
    for (const auto& channel : animation.channels) {
      const auto target = path_named(channel.target_path);
      const auto node = static_cast<size_t>(channel.target_node);
      if (target && *target != KeyPath::kWeights && node < driven.size()) driven[node] = 1;
    }
  return driven;
}

}  // namespace nerf::internal
