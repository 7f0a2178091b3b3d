#include "render_options.h"

#include <fmt/format.h>

#include <charconv>
#include <cmath>
#include <string_view>

#include "medium_option.h"
#include "nerf/base/error.h"

namespace nerf::apps {

std::optional<ImageSize> parse_image_size(const std::string& text) {
  ImageSize size;
  const char* end = text.data() + text.size();
  const auto width = std::from_chars(text.data(), end, size.width);
  if (width.ec != std::errc() || width.ptr == end || *width.ptr != 'x') return std::nullopt;
  const auto height = std::from_chars(width.ptr + 1, end, size.height);
  if (height.ec != std::errc() || height.ptr != end) return std::nullopt;
  for (const int side : {size.width, size.height})
    if (side < 1 || side > kLargestSide) return std::nullopt;
  return size;
}

std::optional<TimeSpan> parse_time_span(const std::string& text) {
  const auto number = [](std::string_view part) -> std::optional<double> {
    double value = 0;
    const auto [end, problem] = std::from_chars(part.data(), part.data() + part.size(), value);
    const bool whole = problem == std::errc() && end == part.data() + part.size();
    return whole && std::isfinite(value) ? std::optional(value) : std::nullopt;
  };
  const std::string_view all = text;
  const size_t dots = all.find("..");
  const auto from = number(all.substr(0, dots));
  const auto to = dots == all.npos ? from : number(all.substr(dots + 2));
  return from && to ? std::optional(TimeSpan{*from, *to}) : std::nullopt;
}

std::string time_span_text(const TimeSpan& span) {
  return span.from == span.to ? fmt::format("{}", span.from)
                              : fmt::format("{}..{}", span.from, span.to);
}

void RenderCommand::check_options() const {
  layers.check_options(!object.insert.empty());
  object.check_options();
  if (!medium.empty()) parse_medium(medium, {});  // before a model is read
  if (time && freeze_time)
    throw Error("--time and --freeze-time exclude each other", "", "leave one of them out");
  if (freeze_time && !freeze_camera.empty())
    throw Error("--freeze-time and --freeze-camera leave nothing that moves", "",
                "give --time T for pictures of one moment");
  if (size && downscale > 1)
    throw Error("--size and --downscale exclude each other", "", "give the final size to --size");
  if (out.empty()) throw Error("the folder's name is empty", "--out");
  if (!path.empty() && views != RenderCommand().views)
    throw Error("--path and --views exclude each other", "--path", "give one of them");
  const bool timed =
      is_gltf(path.empty() ? std::filesystem::path(views) : path) || !object.insert.empty();
  if (fps && mp4.empty() && !timed)
    throw Error("pictures have no speed", "--fps", "give --mp4 FILE too, or leave it out");
  if (look.film != FilmKind::kColour && mp4.empty())
    throw Error("there is no film", "--film", "give --mp4 FILE too, or leave it out");
  if (look.film != FilmKind::kColour && !depth)
    throw Error("this film shows depth", "--film", "leave --no-depth out");
  if (!mp4.empty() && mp4.extension() != ".mp4")
    throw Error("'" + mp4.string() + "' does not end in .mp4", "--mp4");
}

ProgramText render_program_text() {
  return {"nerf_render", "Renders pictures and videos of a trained radiance field.",
          "Pictures are PNG files named after the views they show (orbit_0000.png, ...); near is "
          "red and far\nis blue in depth pictures. Coordinates are those of the capture that the "
          "model was trained on.\n"
          "Exit code 0: done, 2: something to correct, 128 + n: stopped by signal n.",
          "  nerf_render run --views test -o renders\n"
          "  nerf_render run --views orbit -o orbit --size 800x600 --mp4 orbit.mp4"};
}

}  // namespace nerf::apps

template nerf::CollectedOptions nerf::collect_options(nerf::apps::RenderCommand&);
