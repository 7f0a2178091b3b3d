// Animations of glTF files: curves through keys, and what they drive (section 3.11 of glTF 2.0).
#pragma once

#include <tiny_gltf.h>

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "gltf_nodes.h"

namespace nerf::internal {

// Values between keys; before the first and after the last that key's.
class KeyCurve {
 public:
  enum class Shape { kLinear, kStep, kCubic };

  // times: seconds, rising. values: of each key `width` numbers; of kCubic three times as many: the
  // slope towards it, the value, the slope after it, per second. turns: values are unit quaternions
  // (x, y, z, w), which kLinear leads along the shorter arc.
  KeyCurve(std::vector<double> times, std::vector<double> values, Shape shape, bool turns);

  const std::vector<double>& times() const { return times_; }
  size_t width() const { return width_; }
  void at(double seconds, std::span<double> out) const;

 private:
  std::span<const double> key(size_t i, size_t part) const;

  std::vector<double> times_, values_;
  Shape shape_;
  bool turns_;
  size_t width_, parts_;  // numbers of a value; values of a key
};

// What of a node a channel drives.
enum class KeyPath { kMove, kTurn, kScale, kWeights };

class GltfAnimation {
 public:
  struct Choice {
    std::vector<char> nodes;            // those that count
    std::vector<size_t> morph_targets;  // of each node's mesh; empty: weights do not count
    std::string name;                   // of the animation that plays; empty: see below
  };
  // Without a name the file's first animation plays of those that drive nodes that count, and with
  // it each that drives nothing that one before it does: exporters make an animation for each
  // object, or several that are meant to take turns. Throws Error where there is none of this name,
  // and where what plays is damaged.
  GltfAnimation(const tinygltf::Model& model, const GltfNodes& nodes, const Choice& choice,
                const std::filesystem::path& path);

  bool empty() const { return channels_.empty(); }
  // Seconds of the first key and of the last. Of one that is not empty.
  double first() const;
  double last() const;
  const std::vector<KeyCurve>& curves() const { return curves_; }
  // Names of animations that drive nodes that count and do not play.
  const std::vector<std::string>& others() const { return others_; }
  void pose(double seconds, std::vector<NodePose>& poses) const;

 private:
  struct Channel {
    size_t node, curve;
    KeyPath path;
  };
  std::vector<Channel> channels_;
  std::vector<KeyCurve> curves_;
  std::vector<std::string> others_;
};

// Nodes that any of the file's animations moves, turns or scales.
std::vector<char> driven_nodes(const tinygltf::Model& model);

}  // namespace nerf::internal
