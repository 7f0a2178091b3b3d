#include "insert_object.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <numbers>
#include <sstream>
#include <string_view>

#include "nerf/base/error.h"
#include "nerf/base/nearest_name.h"
#include "nerf/base/text.h"
#include "nerf/io/mesh_file.h"
#include "nerf/model/integrator.h"

namespace nerf::apps {
namespace {

constexpr const char* kFloor = "floor";

const ModelView& view_named(const std::string& name, const ModelInfo& info) {
  if (info.views.empty()) throw Error("the model knows of no views", "--place", "give --at");
  if (name == kFloor) return info.views.front();
  std::vector<std::string> names;
  for (const ModelView& view : info.views) {
    if (view.name == name || std::filesystem::path(view.name).stem() == name) return view;
    names.push_back(view.name);
  }
  throw Error("'" + name + "' is no view of the model", "--place", nearest_name_hint(name, names));
}

// The middle of what a few pixels around one see. Engine coordinates.
Vec3d surface_under(PlacePixel place, const RadianceField& field, const RenderOptions& render,
                    ThreadPool& pool) {
  const ModelView& view = view_named(place.view, field.info());
  const Camera camera = view.camera.in_unit(field.info().to_engine.scale);
  const Pose pose = field.info().to_engine.apply(view.pose);
  if (place.percent_x) place.pixel.x *= camera.width / 100.0;
  if (place.percent_y) place.pixel.y *= camera.height / 100.0;
  if (!(place.pixel.x >= 0 && place.pixel.y >= 0 && place.pixel.x <= camera.width &&
        place.pixel.y <= camera.height))
    throw Error(fmt::format("view {} has {} x {} pixels", view.name, camera.width, camera.height),
                "--place");
  std::vector<Ray> rays;
  for (int y = -2; y <= 2; ++y)
    for (int x = -2; x <= 2; ++x) {
      auto ray = camera_ray(camera, pose, {place.pixel.x + x, place.pixel.y + y});
      if (!ray) continue;
      ray->near = field.info().near;
      ray->time = render.time;
      rays.push_back(*ray);
    }
  const RayResults seen = integrate(field, rays, {}, render, pool);
  std::vector<Real> distances;
  for (const Real d : seen.median)
    if (d > 0) distances.push_back(d);
  const auto ray = camera_ray(camera, pose, place.pixel);
  if (2 * distances.size() <= rays.size() || !ray)
    throw Error("nothing is seen in this pixel", "--place", "give another one, or --at");
  const auto middle = distances.begin() + static_cast<ptrdiff_t>(distances.size() / 2);
  std::nth_element(distances.begin(), middle, distances.end());
  return ray->origin + ray->direction * static_cast<double>(*middle);
}

Mat3d turn_about(int axis, double degrees) {
  const double a = degrees * std::numbers::pi / 180, c = std::cos(a), s = std::sin(a);
  const size_t u = static_cast<size_t>((axis + 1) % 3), v = static_cast<size_t>((axis + 2) % 3);
  Mat3d r;
  r.m[u][u] = r.m[v][v] = c;
  r.m[u][v] = -s;
  r.m[v][u] = s;
  return r;
}

}  // namespace

void InsertOptions::check_options() const {
  if (insert.empty()) {
    const InsertOptions none;
    if (at || !place.empty() || !light.empty() || scale != none.scale || !(rotate == none.rotate) ||
        !field_light || !object_shadow || !object_animation.empty() || object_start != 0 ||
        !object_loop)
      throw Error("there is no object to place", "--insert", "give --insert FILE");
    return;
  }
  if (at && !place.empty())
    throw Error("--at and --place exclude each other", "--place", "give one of them");
  if (!place.empty() && !parse_place(place))
    throw Error("'" + place + "' is no place", "--place", "give VIEW@X,Y, as in floor@400,300");
  if (parse_lights(light).empty() && !field_light)
    throw Error("no light is left", "--no-field-light", "give --light X,Y,Z");
}

std::vector<DistantLight> parse_lights(const std::string& text) {
  constexpr double kMost = 1e6;
  std::vector<DistantLight> lights;
  std::istringstream words(text);
  for (std::string word; words >> word;) {
    const auto fail = [&](const std::string& problem) {
      throw Error("'" + word + "' " + problem, "--light",
                  "give X,Y,Z or X,Y,Z:R,G,B, as in 1,0.5,2:0.9,0.8,0.6");
    };
    const auto three = [&](std::string_view numbers, double least) {
      Vec3d v;
      for (int k = 0; k < 3; ++k) {
        const size_t end = k < 2 ? numbers.find(',') : numbers.size();
        const auto number =
            end == numbers.npos ? std::nullopt : number_in(numbers.substr(0, end), least, kMost);
        if (!number)
          fail(
              fmt::format("is no light: three numbers from {:g} to {:g} are wanted", least, kMost));
        v[k] = *number;
        numbers.remove_prefix(std::min(end + 1, numbers.size()));
      }
      return v;
    };
    const size_t colon = word.find(':');
    const Vec3d towards = three(std::string_view(word).substr(0, colon), -kMost);
    const double strength = length(towards);
    if (!(strength > 0)) fail("has no direction");
    lights.push_back({towards / strength,
                      colon == word.npos ? Vec3d{1, 1, 1} * strength
                                         : three(std::string_view(word).substr(colon + 1), 0)});
  }
  return lights;
}

std::optional<PlacePixel> parse_place(const std::string& text) {
  const size_t at = text.rfind('@');
  if (at == std::string::npos || at == 0) return std::nullopt;
  PlacePixel place{text.substr(0, at), {}};
  const char* const end = text.data() + text.size();
  const char* from = text.data() + at + 1;
  const auto read = [&](double& number, bool& percent) {
    const auto result = std::from_chars(from, end, number);
    if (result.ec != std::errc() || !std::isfinite(number)) return false;
    from = result.ptr;
    percent = from != end && *from == '%';
    from += percent;
    return true;
  };
  if (!read(place.pixel.x, place.percent_x) || from == end || *from++ != ',') return std::nullopt;
  if (!read(place.pixel.y, place.percent_y) || from != end) return std::nullopt;
  return place;
}

Similarity object_to_input(const InsertOptions& options, const RadianceField& field,
                           const SceneObject& object, const RenderOptions& render,
                           ThreadPool& pool) {
  const ModelInfo& info = field.info();
  const Mat3d turn = turn_about(2, options.rotate.z) * turn_about(1, options.rotate.y) *
                     turn_about(0, options.rotate.x);
  // x -> at + scale * upright * turn * (x - pivot).
  const Mat3d upright = input_to_gltf(info).rotation.transposed();
  Vec3d at = options.at.value_or(info.to_engine.center), pivot;
  if (const auto place = parse_place(options.place)) {
    at = info.to_engine.apply_inverse(surface_under(*place, field, render, pool));
    Box3 box;  // of the turned object
    for (const Vec3& p : object.mesh.positions) box.extend(turn * p.cast<double>());
    pivot = turn.transposed() * Vec3d{box.center().x, box.min.y, box.center().z};
  }
  const Mat3d rotation = upright * turn;
  // Similarities take their centre to the origin.
  return {options.scale, rotation, pivot - rotation.transposed() * at / options.scale};
}

double played_time(double seconds, double first, double last, bool loop) {
  if (seconds < first) return first;
  if (seconds <= last || !(last > first)) return std::min(seconds, last);
  return loop ? first + std::fmod(seconds - first, last - first) : last;
}

void InsertedObject::show(double seconds, const RenderOptions& render, ThreadPool& pool) {
  if (!motion) return;
  const double at = played_time(start + seconds, motion->first(), motion->last(), loop);
  if (at == shown) return;
  shown = at;
  TriangleMesh moved = mesh;
  motion->pose(at, moved);
  if (moved.positions == mesh.positions && moved.normals == mesh.normals &&
      moved.triangles == mesh.triangles)
    return;
  mesh = moved;
  place_mesh(to_engine, moved);
  insertion->move(std::move(moved), render, pool);
}

InsertedObject insert_object(const InsertOptions& options, const RadianceField& field,
                             double seconds, const RenderOptions& render, ThreadPool& pool) {
  InsertedObject inserted;
  if (options.insert.empty()) return inserted;
  ReadObject read = read_object(options.insert, options.object_animation);
  inserted.notes = std::move(read.notes);
  inserted.motion = std::move(read.motion);
  inserted.start = options.object_start;
  inserted.loop = options.object_loop;
  if (auto& motion = inserted.motion) {
    inserted.shown =
        played_time(inserted.start + seconds, motion->first(), motion->last(), inserted.loop);
    motion->pose(inserted.shown, read.object.mesh);
    inserted.mesh = read.object.mesh;
  }
  if (!inserted.motion && (options.object_start != 0 || !options.object_loop))
    inserted.notes.push_back(
        "--object-start and --no-object-loop change nothing: the object does not move");
  const Similarity to_input = object_to_input(options, field, read.object, render, pool);
  if (!options.place.empty()) {
    const Vec3d at = to_input.apply(Vec3d());
    inserted.notes.push_back(
        fmt::format("--place {} is --at {:.6g},{:.6g},{:.6g}", options.place, at.x, at.y, at.z));
  }
  inserted.to_engine = field.info().to_engine * to_input;
  place_mesh(inserted.to_engine, read.object.mesh);
  InsertionOptions insertion;
  insertion.field_light = options.field_light;
  insertion.shadows = options.object_shadow;
  insertion.moves = inserted.motion != nullptr;
  insertion.lights = parse_lights(options.light);
  for (DistantLight& light : insertion.lights)
    light.towards = field.info().to_engine.rotation * light.towards;
  inserted.insertion =
      std::make_unique<Insertion>(field, std::move(read.object), insertion, render, pool);
  return inserted;
}

}  // namespace nerf::apps
