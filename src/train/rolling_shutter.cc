#include "train/rolling_shutter.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <map>
#include <numbers>
#include <optional>
#include <span>
#include <tuple>
#include <utility>

#include "nerf/base/error.h"
#include "nerf/base/text.h"
#include "nerf/math/median.h"

namespace nerf {

namespace {

std::optional<Readout> readout_from(const std::string& text) {
  if (text == "off") return Readout{};
  if (text == "auto") return Readout{true, 0};
  const auto share = number_in(text, 0, kMostReadout);
  if (!share) return std::nullopt;
  return Readout{false, *share};
}

// A sensor's lines are its long side. Phones and ffmpeg turn what was filmed upright: what was the
// top of the sensor is then on the right.
Vec2d reading_direction(FirstLine first, const Camera& camera) {
  switch (first) {
    case FirstLine::kTop:
      return {0, 1};
    case FirstLine::kBottom:
      return {0, -1};
    case FirstLine::kLeft:
      return {1, 0};
    case FirstLine::kRight:
      return {-1, 0};
    case FirstLine::kAuto:
      break;
  }
  return camera.height > camera.width ? Vec2d{-1, 0} : Vec2d{0, 1};
}

std::string first_line_text(const LineMotion& lines) {
  if (lines.along.x != 0) return lines.along.x > 0 ? "left" : "right";
  return lines.along.y > 0 ? "top" : "bottom";
}

std::string folder_of(const View& view) {
  return std::filesystem::path(view.name).parent_path().string();
}

// Views that one camera took one after another: of each such film its views by their time.
std::vector<std::vector<size_t>> films_of(const Scene& scene) {
  std::map<std::tuple<std::string, int, int>, std::vector<size_t>> films;
  for (size_t v = 0; v < scene.views.size(); ++v) {
    const View& view = scene.views[v];
    if (!view.clock)
      throw Error("a rolling shutter needs to know when the photos were taken", view.name,
                  "train on a video, number the frames in their names, or say times with --times; "
                  "of other photos leave --rolling-shutter out");
    films[{folder_of(view), view.ids.camera, view.scale}].push_back(v);
  }
  std::vector<std::vector<size_t>> out;
  for (auto& [key, views] : films) {
    std::ranges::stable_sort(views, {}, [&](size_t v) { return *scene.views[v].clock; });
    out.push_back(std::move(views));
  }
  return out;
}

}  // namespace

void OptionTraits<Readout>::describe(OptionField& f) {
  f.metavar = "off|X|auto";
  f.problem = [](const OptionValue& value) {
    return readout_from(std::get<std::string>(value))
               ? ""
               : "expected off, auto or a share of a frame's time from 0 to 1.5";
  };
}

OptionValue OptionTraits<Readout>::to_value(const Readout& x) {
  if (x.learnt) return std::string("auto");
  if (x.share == 0) return std::string("off");
  char text[32];
  const auto end = std::to_chars(text, text + sizeof(text), x.share).ptr;
  return std::string(text, end);
}

Readout OptionTraits<Readout>::from_value(const OptionValue& v) {
  return readout_from(std::get<std::string>(v)).value_or(Readout{});
}

std::vector<int> lens_groups(const Scene& scene) {
  const auto same = [](const Camera& a, const Camera& b) {
    return a.model == b.model && a.width == b.width && a.height == b.height && a.params == b.params;
  };
  std::vector<int> groups;
  std::vector<size_t> firsts;
  for (size_t c = 0; c < scene.cameras.size(); ++c) {
    size_t group = 0;
    while (group < firsts.size() && !same(scene.cameras[firsts[group]], scene.cameras[c])) ++group;
    if (group == firsts.size()) firsts.push_back(c);
    groups.push_back(static_cast<int>(group));
  }
  return groups;
}

RollingShutter::RollingShutter(const Scene& scene, const CameraRecipe& recipe)
    : scene_(scene), learnt_(recipe.rolling_shutter.learnt) {
  std::map<std::pair<std::string, int>, size_t> cameras;
  for (const View& view : scene.views) {
    const size_t camera = static_cast<size_t>(view.camera);
    const auto own = cameras.try_emplace({folder_of(view), view.ids.camera}, cameras.size());
    camera_of_.push_back(own.first->second);
    LineMotion lines;
    lines.along = reading_direction(recipe.first_line, scene.cameras[camera]);
    lines.middle = 0.5 * (lines.along.x + lines.along.y);
    lines_.push_back(lines);
  }
  readouts_.assign(cameras.size(), recipe.rolling_shutter.share);
  find_twists(scene, films_of(scene));
}

void RollingShutter::find_twists(const Scene& scene,
                                 const std::vector<std::vector<size_t>>& films) {
  constexpr double kLongest = 3;  // of the usual intervals
  // A film's frames are turned by few degrees; photos of a capture by tens.
  constexpr double kMostTurn = 25 * std::numbers::pi / 180;
  const auto pose = [&](size_t v) -> const Pose& { return scene.views[v].pose; };
  // From one view to another, in the first one's axes.
  const auto between = [&](size_t from, size_t to) {
    return twist_of(moved(pose(from).inverse(), pose(to)));
  };
  std::vector<double> intervals, turns;
  for (const std::vector<size_t>& film : films)
    for (size_t i = 1; i < film.size(); ++i) {
      const double interval = *scene.views[film[i]].clock - *scene.views[film[i - 1]].clock;
      if (!(interval > 0)) continue;
      intervals.push_back(interval);
      turns.push_back(length(between(film[i - 1], film[i]).rotation) / interval);
    }
  usual_ = median_of(intervals);
  interval_ = scene.frame_interval > 0 ? scene.frame_interval : usual_;
  if (!(usual_ > 0))
    throw Error("no two of the photos were taken one after another", scene.root.string(),
                "leave --rolling-shutter out, or say the photos' times with --times");
  if (const double turn = median_of(turns) * interval_; turn > kMostTurn)
    throw Error(fmt::format("from frame to frame the camera is turned by {:.0f} degrees: these are "
                            "no frames of a film",
                            turn * 180 / std::numbers::pi),
                scene.root.string(), "leave --rolling-shutter out");
  twists_.resize(scene.views.size());
  for (const std::vector<size_t>& film : films)
    for (size_t i = 0; i < film.size(); ++i) {
      const double now = *scene.views[film[i]].clock;
      // Velocity to a neighbour, and how far away it is in time; 0: too far.
      const auto velocity = [&](size_t other, double& apart) {
        const double step = *scene.views[film[other]].clock - now;
        apart = std::abs(step);
        if (!(apart > 0) || apart > kLongest * usual_) apart = 0;
        return apart > 0 ? between(film[i], film[other]) * (1 / step) : Twist();
      };
      double before = 0, after = 0;
      Twist back, ahead;
      if (i > 0) back = velocity(i - 1, before);
      if (i + 1 < film.size()) ahead = velocity(i + 1, after);
      if (before + after == 0) continue;
      ++moving_;
      // The nearer neighbour says more; of one alone all.
      const double share = before > 0 && after > 0 ? before / (before + after)
                           : after > 0             ? 1.0
                                                   : 0.0;
      const Twist a = ahead * share, b = back * (1 - share);
      twists_[film[i]] = Twist{a.rotation + b.rotation, a.translation + b.translation} * interval_;
    }
}

LineMotion RollingShutter::motion(size_t view) const {
  LineMotion lines = lines_[view];
  lines.twist = twists_[view] * readouts_[camera_of(view)];
  return lines;
}

void RollingShutter::place(PixelSource& source) const {
  for (size_t i = 0; i < scene_.train.size(); ++i) {
    Camera camera = source.camera_of(i);
    camera.motion = motion(static_cast<size_t>(scene_.train[i]));
    camera.motion.twist.translation = camera.motion.twist.translation * scene_.to_engine.scale;
    source.place(i, source.pose_of(i), camera);
  }
}

std::string RollingShutter::description() const {
  std::string readouts;
  const size_t differing = learnt_ ? readouts_.size() : std::min<size_t>(readouts_.size(), 1);
  for (const double share : std::span(readouts_).first(differing))
    readouts += fmt::format("{}{:.3g}", readouts.empty() ? "" : ", ", share);
  return fmt::format(
      "rolling shutter: {}{} of the time between two frames ({:.4g}), from the {}; {} of {} photos "
      "have neighbours in time",
      learnt_ ? "learnt so far: " : "", readouts, interval_,
      lines_.empty() ? "" : first_line_text(lines_.front()), moving_, twists_.size());
}

}  // namespace nerf
