#include "model/model_info_json.h"

#include <algorithm>
#include <cmath>

#include "nerf/math/camera_paths.h"

namespace nerf::internal {
namespace {

using Json = nlohmann::ordered_json;

constexpr int64_t kLargestSide = 1 << 20;  // pixels
constexpr double kMostIds = 1 << 24;

}  // namespace

Json rotation_to_json(const Mat3d& r) {
  Json list = Json::array();
  for (const auto& row : r.m)
    for (double x : row) list.push_back(x);
  return list;
}

namespace {

Json vector_to_json(const Vec3d& v) { return {v.x, v.y, v.z}; }

Vec3d vector_from(const JsonFields& f, const char* key) {
  const auto v = f.numbers(key, 3);
  return {v[0], v[1], v[2]};
}

}  // namespace

Mat3d rotation_from(const JsonFields& f, const char* key) {
  const auto v = f.numbers(key, 9);
  Mat3d r;
  for (size_t i = 0; i < 9; ++i) r.m[i / 3][i % 3] = v[i];
  if (!(orthonormality_error(r) < 1e-3)) f.fail("is not a rotation", key);
  return r;
}

namespace {

Json camera_to_json(const Camera& camera) {
  Json params = Json::array();
  for (int i = 0; i < camera_model_params(camera.model); ++i)
    params.push_back(camera.params[static_cast<size_t>(i)]);
  return {{"model", camera_model_name(camera.model)},
          {"width", camera.width},
          {"height", camera.height},
          {"params", params}};
}

Json line_motion_to_json(const LineMotion& m) {
  return {{"rotation", vector_to_json(m.twist.rotation)},
          {"translation", vector_to_json(m.twist.translation)},
          {"along", {m.along.x, m.along.y}},
          {"middle", m.middle}};
}

LineMotion line_motion_from(const JsonFields& f) {
  const auto along = f.numbers("along", 2);
  return {{vector_from(f, "rotation"), vector_from(f, "translation")},
          {along[0], along[1]},
          f.number("middle")};
}

Camera camera_from(const JsonFields& f) {
  Camera camera;
  const auto model = camera_model_from_name(f.text("model"));
  if (!model) f.fail("'" + f.text("model") + "' is no camera model", "model");
  camera.model = *model;
  camera.width = static_cast<int>(f.integer("width", 1, kLargestSide));
  camera.height = static_cast<int>(f.integer("height", 1, kLargestSide));
  const auto params = f.numbers("params", static_cast<size_t>(camera_model_params(*model)));
  std::copy(params.begin(), params.end(), camera.params.begin());
  return camera;
}

}  // namespace

Json model_info_to_json(const ModelInfo& info) {
  Json views = Json::array();
  for (const ModelView& v : info.views) {
    views.push_back({{"name", v.name},
                     {"held_out", v.held_out},
                     {"time", v.time},
                     {"camera", camera_to_json(v.camera)},
                     {"rotation", rotation_to_json(v.pose.rotation)},
                     {"centre", vector_to_json(v.pose.translation)}});
    if (v.motion.any()) views.back()["line_motion"] = line_motion_to_json(v.motion);
    if (v.ids != ViewIds{}) views.back()["ids"] = {v.ids.moment, v.ids.appearance, v.ids.camera};
  }
  Json json = {{"method", info.method},
               {"unbounded", info.unbounded},
               {"alpha", info.alpha},
               {"background", {info.background.x, info.background.y, info.background.z}},
               {"near", info.near},
               {"far", info.far},
               {"to_engine",
                {{"scale", info.to_engine.scale},
                 {"rotation", rotation_to_json(info.to_engine.rotation)},
                 {"centre", vector_to_json(info.to_engine.center)}}},
               {"views", views}};
  if (const CaptureTimes& t = info.times; !t.source.empty())
    json["times"] = {
        {"first", t.first}, {"last", t.last}, {"seconds", t.seconds}, {"source", t.source}};
  return json;
}

ModelInfo model_info_from_json(const JsonFields& header) {
  ModelInfo info;
  info.method = header.text("method");
  info.unbounded = header.boolean("unbounded");
  info.alpha = header.boolean("alpha");
  if (header.has("background")) {  // files from before it could be chosen have none
    const Vec3d colour = vector_from(header, "background");
    for (int k = 0; k < 3; ++k) {
      if (!(colour[k] >= 0 && colour[k] <= 1))
        header.fail("expected colours from 0 to 1", "background");
      info.background[k] = static_cast<Real>(colour[k]);
    }
  }
  info.near = header.number("near");
  info.far = header.number("far");
  const JsonFields frame = header.object("to_engine");
  info.to_engine.scale = frame.number("scale");
  if (!(info.to_engine.scale > 0)) frame.fail("must be above 0", "scale");
  info.to_engine.rotation = rotation_from(frame, "rotation");
  info.to_engine.center = vector_from(frame, "centre");
  if (header.has("times")) {  // of captures that move
    const JsonFields t = header.object("times");
    info.times = {t.number("first"), t.number("last"), t.boolean("seconds"), t.text("source")};
    if (!(info.times.first <= info.times.last)) t.fail("ends before it begins", "last");
  }
  for (const JsonFields& v : header.objects("views")) {
    ModelView view;
    view.name = v.text("name");
    view.held_out = v.boolean("held_out");
    view.time = v.number("time");
    if (v.has("ids")) {
      const auto ids = v.numbers("ids", 3);
      for (const double id : ids)
        if (!(id >= -1 && id < kMostIds && id == std::floor(id)))
          v.fail("expected whole numbers from -1 on", "ids");
      view.ids = {static_cast<int>(ids[0]), static_cast<int>(ids[1]), static_cast<int>(ids[2])};
    }
    view.camera = camera_from(v.object("camera"));
    if (v.has("line_motion")) view.motion = line_motion_from(v.object("line_motion"));
    view.pose.rotation = rotation_from(v, "rotation");
    view.pose.translation = vector_from(v, "centre");
    info.views.push_back(std::move(view));
  }
  return info;
}

}  // namespace nerf::internal

namespace nerf {

bool has_times(const ModelInfo& info) {
  return std::ranges::any_of(info.views,
                             [&](const ModelView& v) { return v.time != info.views.front().time; });
}

}  // namespace nerf
