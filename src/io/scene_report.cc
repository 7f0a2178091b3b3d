#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <string_view>

#include "nerf/io/scene.h"

namespace nerf {
namespace {

std::string size_text(uint64_t bytes) {
  const double mb = static_cast<double>(bytes) / (1 << 20);
  return mb < 1024 ? fmt::format("{:.0f} MB", mb) : fmt::format("{:.1f} GB", mb / 1024);
}

std::string vector_text(const Vec3d& v) {
  return fmt::format("({:.4g}, {:.4g}, {:.4g})", v.x, v.y, v.z);
}

// The box as --bbox takes it, to a thousandth of its size: projected coordinates are large.
std::string box_text(const Box3& box) {
  const Vec3d size = box.size();
  const double step = std::max({size.x, size.y, size.z}) / 1000;
  const bool usual = step > 0 && std::isfinite(step);
  const int digits = usual ? std::clamp(static_cast<int>(std::ceil(-std::log10(step))), 0, 9) : 4;
  std::string text;
  for (const Vec3d& corner : {box.min, box.max})
    for (int k = 0; k < 3; ++k)
      text += fmt::format("{}{:.{}f}", text.empty() ? "" : ",", corner[k], digits);
  return text;
}

class Lines {
 public:
  void add(std::string_view label, const std::string& text) {
    out_ += fmt::format("{:<14}{}\n", label, text);
  }
  template <class List>
  void add_list(std::string_view label, const List& list) {
    for (size_t i = 0; i < list.size(); ++i) add(i == 0 ? label : "", list[i]);
  }
  std::string take() { return std::move(out_); }

 private:
  std::string out_;
};

}  // namespace

std::string format_report(const SceneReport& r) {
  Lines lines;
  lines.add("scene", r.format);
  std::string images = fmt::format("{} registered of {}", r.images_registered, r.images_total);
  if (r.images_missing > 0) images += fmt::format(", {} missing", r.images_missing);
  lines.add("images", images);
  lines.add_list("cameras", r.camera_models);
  if (r.points > 0) {
    lines.add("points", r.mean_reprojection_error > 0
                            ? fmt::format("{}, mean reprojection error {:.2f} px", r.points,
                                          r.mean_reprojection_error)
                            : fmt::format("{}", r.points));
  } else {
    lines.add("points", "none");
  }
  lines.add("extent", box_text(r.extent) + " (as --bbox takes it)");
  lines.add("near, far", fmt::format("{:.4g}, {:.4g}", r.near, r.far));
  lines.add("up", r.up_source.empty() ? vector_text(r.up)
                                      : fmt::format("{}, {}", vector_text(r.up), r.up_source));
  if (r.masks > 0) {
    lines.add("masks",
              fmt::format("{} of {} images", r.masks, r.images_registered - r.images_missing));
    lines.add("", r.mask_convention);
  }
  if (!r.times.empty()) lines.add("times", r.times);
  if (!r.exposure.empty()) lines.add("exposure", r.exposure);
  if (!r.cut_out.empty()) lines.add("cut out", r.cut_out);
  lines.add("memory", r.memory_limit_bytes > 0
                          ? fmt::format("about {} of {}", size_text(r.memory_estimate_bytes),
                                        size_text(r.memory_limit_bytes))
                          : fmt::format("about {}", size_text(r.memory_estimate_bytes)));
  lines.add_list("note", r.notes);
  lines.add_list("ignored", r.ignored);
  lines.add_list("warning", r.warnings);
  return lines.take();
}

}  // namespace nerf
