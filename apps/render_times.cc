#include "render_times.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <set>

#include "nerf/base/error.h"

namespace nerf::apps {
namespace {

namespace fs = std::filesystem;

constexpr int kUsualFrames = 120;
constexpr int kFewMoments = 24;                 // a film of fewer frames is over before it is seen
constexpr double kSlowest = 1, kFastest = 120;  // frames per second

// A time as the command gives it, from 0 to 1.
double checked_time(const RenderCommand& command, const ModelInfo& info, double given,
                    const char* option) {
  const bool unit = command.time_unit == TimeUnit::kCapture;
  if (unit && info.times.source.empty())
    throw Error("the capture that the model is of has no times of its own", "--time-unit",
                "leave it out: 0 is its first moment and 1 its last");
  const double first = unit ? info.times.first : 0, last = unit ? info.times.last : 1;
  if (!(given >= first && given <= last))
    throw Error(fmt::format("{:g} is outside {:g} to {:g}", given, first, last), option,
                unit ? "these are the capture's first moment and its last"
                     : "0 is the capture's first moment and 1 its last; --time-unit capture takes "
                       "its own unit");
  return unit ? info.times.from_unit(given) : given;
}

}  // namespace

std::optional<PathFrame> photo_frame(const std::string& name, const ModelInfo& info) {
  for (const ModelView& view : info.views) {
    const fs::path path = view.name;
    for (const fs::path& known :
         {path, path.filename(), path.parent_path() / path.stem(), path.stem()})
      if (known.generic_string() == name)
        return PathFrame{path.stem().string(), view.camera, view.pose, view.time};
  }
  return std::nullopt;
}

PathFrame numbered_frame(const std::string& number, const CameraPath& path) {
  size_t index = 0;
  const char* end = number.data() + number.size();
  const auto [stop, problem] = std::from_chars(number.data(), end, index);
  if (problem == std::errc() && stop == end && index < path.frames.size())
    return path.frames[index];
  throw Error(
      fmt::format("'{}' is no photo of the model and no number of a frame of --views", number),
      "--freeze-camera",
      fmt::format("give a photo's name, or a number from 0 to {}", path.frames.size() - 1));
}

std::vector<PathFrame> film_of(PathFrame frame, std::optional<int> count, const ModelInfo& info) {
  std::set<double> moments;
  for (const ModelView& view : info.views) moments.insert(view.time);
  const int own = static_cast<int>(moments.size());
  const int frames = count.value_or(own >= kFewMoments ? own : kUsualFrames);
  const std::string name = fs::path(frame.name).stem().string();
  std::vector<PathFrame> film;
  for (int i = 0; i < frames; ++i) {
    frame.name = fmt::format("{}_{:04}", name, i);
    frame.time = own > 1 && frames > 1 ? static_cast<double>(i) / (frames - 1) : 0;
    film.push_back(frame);
  }
  return film;
}

void set_times(const RenderCommand& command, const ModelInfo& info, bool moves, CameraPath& path) {
  for (const auto& [given, option] : {std::pair{command.time.has_value(), "--time"},
                                      std::pair{command.freeze_time.has_value(), "--freeze-time"},
                                      std::pair{!command.freeze_camera.empty(), "--freeze-camera"}})
    // The last two stop and start what is inserted.
    if (given && !moves && (command.object.insert.empty() || option == std::string_view("--time")))
      path.notes.push_back(fmt::format(
          "{} changes nothing of what is seen: the model is of a scene that stands still", option));
  if (!moves) return;
  std::optional<TimeSpan> span = command.time;
  const char* option = "--time";
  if (command.freeze_time) {
    span = TimeSpan{*command.freeze_time, *command.freeze_time};
    option = "--freeze-time";
  }
  if (!span) return;
  const double from = checked_time(command, info, span->from, option),
               to = checked_time(command, info, span->to, option);
  const size_t last = path.frames.size() - 1;
  for (size_t i = 0; i <= last; ++i)
    path.frames[i].time =
        from + (to - from) * (last > 0 ? static_cast<double>(i) / static_cast<double>(last) : 0);
}

std::optional<double> capture_speed(const ModelInfo& info, const CameraPath& path) {
  if (!info.times.seconds || path.frames.size() < 2) return std::nullopt;
  if (!std::ranges::is_sorted(path.frames, {}, &PathFrame::time)) return std::nullopt;
  const double seconds =
      info.times.to_unit(path.frames.back().time) - info.times.to_unit(path.frames.front().time);
  if (!(seconds > 0)) return std::nullopt;
  return std::clamp(static_cast<double>(path.frames.size() - 1) / seconds, kSlowest, kFastest);
}

}  // namespace nerf::apps
