// Held-out views, and cameras and points in space.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "chart.h"
#include "html_page.h"
#include "nerf/base/error.h"
#include "nerf/base/spread.h"
#include "nerf/io/depth_image.h"
#include "nerf/train/evaluation.h"
#include "report_parts.h"
#include "report_pictures.h"
#include "run_report.h"

namespace nerf::apps {
namespace {

using Json = nlohmann::ordered_json;

constexpr size_t kMostCameras = 2000;

std::string picture(const char* part, const std::vector<uint8_t>& jpeg, const ViewPictures& of,
                    const std::string& caption) {
  return fmt::format(
             "<figure data-part=\"{}\"><img loading=\"lazy\" width=\"{}\" height=\"{}\" alt=\"{}\" "
             "src=\"",
             part, of.width / of.factor, of.height / of.factor, part) +
         jpeg_url(jpeg) + "\"><figcaption>" + xml_escaped(caption) + "</figcaption></figure>\n";
}

std::string scores(const RecordedView& v) {
  std::string text = "PSNR " + figure(v.psnr, 2, "dB") + ", SSIM " + figure(v.ssim, 4);
  if (v.aligned_psnr)
    text +=
        "; aligned PSNR " + figure(v.aligned_psnr, 2, "dB") + ", SSIM " + figure(v.aligned_ssim, 4);
  if (v.scale > 1) text += fmt::format("; at 1/{} of the photo's size", v.scale);
  if (!v.held_out.empty()) text += "; held out in " + v.held_out;
  return text;
}

std::string view_text(size_t index, const RecordedView& v, const ViewPictures& p) {
  const std::string depth =
      v.depth.empty()
          ? std::string("depth: near red, far blue")
          : fmt::format("depth along the axis: {:.4g} (red) to {:.4g} (blue) of the capture's unit",
                        v.depth.near, v.depth.far);
  std::string text = fmt::format("<h3 id=\"{}\">", view_id(index)) + xml_escaped(v.name) +
                     "</h3>\n<p class=\"quiet\">" + xml_escaped(scores(v)) +
                     fmt::format("; {}x{} pixels", p.width, p.height) +
                     (p.factor > 1 ? fmt::format(", shown at 1/{}", p.factor) : "") +
                     "</p>\n<div class=\"view\">\n<div class=\"pictures\">\n";
  text += picture("photo", p.photo, p, "photo");
  text += picture("rendering", p.rendering, p, "rendering");
  text += picture("error", p.error, p, "error");
  text += picture("depth", p.depth, p, depth);
  return text + "</div>\n</div>\n";
}

std::string error_scale() {
  std::string stops;
  for (int i = 0; i <= 10; ++i) {
    const Vec3 c = turbo_color(static_cast<Real>(i / 10.0));
    stops +=
        fmt::format("{}rgb({:.0f},{:.0f},{:.0f})", i ? "," : "", 255 * c.x, 255 * c.y, 255 * c.z);
  }
  return fmt::format(
      "<p class=\"quiet\">Error: mean absolute difference of a pixel's three channels, 0 "
      "<span class=\"scale\" style=\"background:linear-gradient(90deg,{})\"></span> {:g} and more "
      "(of 1; {:.0f} of 255), the same for all views; masked-out pixels are grey in it and dark in "
      "the photo.</p>\n",
      stops, kLargestError, 255 * kLargestError);
}

double percentile(std::vector<double> values, double share) {
  const auto at =
      values.begin() + static_cast<ptrdiff_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

// What the plot shows at first: the cameras around the origin, which is what they look at, and the
// height of the ground below.
struct Stage {
  double radius = 1, ground = 0;
};

Stage stage_of(const std::vector<Vec3d>& cameras, const std::vector<Vec3d>& points) {
  std::vector<double> distances, heights;
  for (const Vec3d& c : cameras) distances.push_back(length(c));
  Stage stage;
  const double radius = 1.1 * percentile(distances, 0.9);
  if (radius > 0 && std::isfinite(radius)) stage.radius = radius;
  for (const Vec3d& p : points)
    if (length(p) < stage.radius) heights.push_back(p.z);
  if (heights.size() < 20) {
    heights.clear();
    for (const Vec3d& c : cameras) heights.push_back(c.z);
  }
  stage.ground = percentile(heights, 0.05);
  return stage;
}

Json numbers(const Vec3d& v, double extent) {
  Json out = Json::array();
  for (int k = 0; k < 3; ++k) out.push_back(shortened_number(v[k], extent));
  return out;
}

Json camera_json(const ModelView& view, const Pose& pose, const std::string& target,
                 double radius) {
  Json rotation = Json::array();
  for (const auto& row : pose.rotation.m)
    for (const double x : row) rotation.push_back(shortened_number(x, 1));
  const auto half = [](int pixels, double focal) {
    return focal > 0 ? shortened_number(std::min(4.0, 0.5 * pixels / focal), 1) : 1.0;
  };
  Json json = {
      {"name", view.name},
      {"held_out", view.held_out},
      {"at", numbers(pose.translation, radius)},
      {"rotation", std::move(rotation)},
      {"half",
       {half(view.camera.width, view.camera.fx()), half(view.camera.height, view.camera.fy())}}};
  if (!target.empty()) json["view"] = target;
  return json;
}

}  // namespace

std::string view_id(size_t index) { return "view-" + std::to_string(index); }

std::string views_part(const RunRecord& record, ThreadPool& pool,
                       std::vector<std::string>& problems) {
  if (record.views.empty()) return "";
  std::vector<size_t> with;
  for (size_t i = 0; i < record.views.size(); ++i)
    if (!record.views[i].picture.empty()) with.push_back(i);
  const std::vector<size_t> chosen = spread_evenly(with.size(), kMostReportViews);
  std::vector<std::string> shown(chosen.size()), failed(chosen.size());
  const std::filesystem::path folder = record.folder / "eval";
  const uint64_t bytes = chosen.empty() ? 0 : kMostPictureBytes / chosen.size();
  pool.parallel_for(static_cast<int64_t>(chosen.size()), [&](int64_t i) {
    const size_t k = static_cast<size_t>(i), index = with[chosen[k]];
    const RecordedView& v = record.views[index];
    try {
      shown[k] = view_text(
          index, v, view_pictures(folder / v.picture, folder / kPictureMasks / v.picture, bytes));
    } catch (const Error& error) {
      failed[k] = error.what();
    }
  });
  for (const std::string& problem : failed)
    if (!problem.empty()) problems.push_back("a held-out view is not shown: " + problem);
  std::string text = "<h2 id=\"views\">Held-out views</h2>\n";
  if (!with.empty())
    text +=
        "<p>Drag the line over a picture: the photo is on its left; on its right is the rendering, "
        "or the picture that was clicked at.</p>\n" +
        error_scale();
  if (with.size() > chosen.size())
    text += fmt::format("<p>{} of {} views are shown, spread evenly; eval/ holds the others.</p>\n",
                        chosen.size(), with.size());
  std::vector<std::vector<std::string>> rows;
  for (const RecordedView& v : record.views)
    if (v.psnr || v.ssim)
      rows.push_back({v.name + (v.scale > 1 ? fmt::format(" at 1/{}", v.scale) : ""),
                      figure(v.psnr, 2), figure(v.ssim, 4), v.held_out});
  const bool moving = std::ranges::any_of(rows, [](const auto& r) { return !r[3].empty(); });
  for (auto& row : rows)
    if (!moving) row.pop_back();
  std::vector<std::string> columns = {"view", "PSNR (dB)", "SSIM"};
  if (moving) columns.push_back("held out in");
  if (!rows.empty())
    text += fmt::format("<details><summary>Scores of {} views</summary>\n", rows.size()) +
            html_table(columns, rows) + "</details>\n";
  for (const std::string& view : shown) text += view;
  return text;
}

std::string space_part(const RunRecord& record) {
  if (!record.model) return "";
  const ModelInfo& info = *record.model;
  std::map<std::string, size_t> targets;
  for (size_t i = 0; i < record.views.size(); ++i)
    if (record.views[i].scale == 1 && !record.views[i].picture.empty())
      targets[record.views[i].name] = i;
  const std::vector<size_t> chosen = spread_evenly(info.views.size(), kMostCameras);
  std::vector<Pose> poses;
  std::vector<Vec3d> places;
  for (const size_t v : chosen) {
    Pose pose = info.to_engine.apply(info.views[v].pose);
    pose.translation = pose.translation / info.to_engine.scale;
    places.push_back(pose.translation);
    poses.push_back(pose);
  }
  if (places.empty()) return "";
  const std::vector<Vec3d>& points = record.notes.points;
  const Stage stage = stage_of(places, points);
  const double radius = stage.radius;
  const double rough = radius / 4, power = std::pow(10, std::floor(std::log10(rough)));
  const double step = (rough >= 5 * power ? 5 : rough >= 2 * power ? 2 : 1) * power;
  int train = 0, held_out = 0;
  for (const ModelView& view : info.views) ++(view.held_out ? held_out : train);
  Json cameras = Json::array(), list = Json::array();
  for (size_t i = 0; i < chosen.size(); ++i) {
    const ModelView& view = info.views[chosen[i]];
    const auto target = targets.find(view.name);
    cameras.push_back(camera_json(view, poses[i],
                                  target == targets.end() ? "" : view_id(target->second), radius));
  }
  for (const Vec3d& p : points)
    for (int k = 0; k < 3; ++k) list.push_back(shortened_number(p[k], radius));
  const Json data = {{"radius", shortened_number(radius, radius)},
                     {"grid",
                      {{"z", shortened_number(stage.ground, radius)},
                       {"step", step},
                       {"count", static_cast<int>(std::ceil(1.2 * radius / step))}}},
                     {"cameras", std::move(cameras)},
                     {"points", std::move(list)}};
  std::string text = fmt::format(
      "<h2 id=\"space\">Cameras and points</h2>\n<p><span class=\"key\" "
      "style=\"background:var(--train)\"></span>{} training cameras <span class=\"key\" "
      "style=\"background:var(--held-out)\"></span>{} held-out cameras",
      train, held_out);
  if (chosen.size() < info.views.size()) text += fmt::format(" ({} shown)", chosen.size());
  text += points.empty()
              ? "; no sparse points are known"
              : fmt::format("; {} of {} sparse points", points.size(), record.notes.points_total);
  return text +
         fmt::format(". A square of the floor's grid is {:g} of the capture's unit wide.</p>\n",
                     step) +
         "<div class=\"plot\"><canvas tabindex=\"0\" role=\"img\" aria-label=\"cameras and points "
         "in space\"></canvas><output></output></div>\n<p class=\"quiet\">Drag to turn, wheel or "
         "two fingers to zoom, shift and drag to move, double click to go back; the name of a "
         "camera stands where the pointer is, a click on a held-out one leads to its view.</p>\n" +
         html_data("space-data", data.dump(-1, ' ', false, Json::error_handler_t::replace));
}

}  // namespace nerf::apps
