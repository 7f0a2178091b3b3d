#include <fmt/format.h>
#include <tiny_gltf.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <fstream>
#include <limits>
#include <numbers>

#include "nerf/base/error.h"
#include "nerf/base/file.h"
#include "nerf/io/mesh_file.h"
#include "nerf/math/camera_paths.h"
#include "nerf/math/srgb.h"

namespace nerf {

namespace {

// Engine axes (+z up) to glTF's (+y up).
Mat3d engine_to_gltf() {
  Mat3d r;
  r.m = {{{1, 0, 0}, {0, 0, 1}, {0, -1, 0}}};
  return r;
}

tinygltf::Value matrix_of(const Similarity& s) {
  tinygltf::Value::Array numbers;
  const Vec3d origin = s.apply(Vec3d{});
  for (int c = 0; c < 4; ++c)
    for (int r = 0; r < 3 + 1; ++r)
      numbers.emplace_back(
          c == 3   ? (r == 3 ? 1.0 : origin[r])
          : r == 3 ? 0.0
                   : s.scale * s.rotation.m[static_cast<size_t>(r)][static_cast<size_t>(c)]);
  return tinygltf::Value(std::move(numbers));
}

// A model of one buffer, which goes into the GLB file itself.
class GlbWriter {
 public:
  explicit GlbWriter(const Similarity& input_to_gltf) {
    model_.asset.version = "2.0";
    model_.asset.generator = "nerf_export";
    tinygltf::Value::Object extras;
    extras["unit"] = tinygltf::Value(std::string("metre"));
    extras["up"] = tinygltf::Value(std::string("+Y"));
    extras["input_to_gltf"] = matrix_of(input_to_gltf);
    model_.asset.extras = tinygltf::Value(std::move(extras));
    model_.scenes.emplace_back();
    model_.defaultScene = 0;
  }

  tinygltf::Model& model() { return model_; }

  int add_node(tinygltf::Node node) {
    const int index = static_cast<int>(model_.nodes.size());
    model_.nodes.push_back(std::move(node));
    model_.scenes[0].nodes.push_back(index);
    return index;
  }

  // count elements, `put(i, k)` the k-th component of the i-th. Returns the accessor.
  template <class T, class Put>
  int add_accessor(size_t count, int components, int component_type, int type, int target,
                   const Put& put) {
    if (model_.buffers.empty()) model_.buffers.emplace_back();
    auto& data = model_.buffers[0].data;
    const size_t begin = data.size(), bytes = count * static_cast<size_t>(components) * sizeof(T);
    data.resize(begin + bytes);
    unsigned char* to = data.data() + begin;
    for (size_t i = 0; i < count; ++i)
      for (int k = 0; k < components; ++k, to += sizeof(T)) {
        const T value = put(i, k);
        std::memcpy(to, &value, sizeof(T));
      }
    tinygltf::BufferView view;
    view.buffer = 0;
    view.byteOffset = begin;
    view.byteLength = bytes;
    view.target = target;
    model_.bufferViews.push_back(view);
    tinygltf::Accessor accessor;
    accessor.bufferView = static_cast<int>(model_.bufferViews.size()) - 1;
    accessor.componentType = component_type;
    accessor.count = count;
    accessor.type = type;
    model_.accessors.push_back(accessor);
    return static_cast<int>(model_.accessors.size()) - 1;
  }

  int add_floats(size_t count, int components, int type, int target,
                 const std::function<double(size_t, int)>& put) {
    return add_accessor<float>(count, components, TINYGLTF_COMPONENT_TYPE_FLOAT, type, target,
                               [&](size_t i, int k) { return static_cast<float>(put(i, k)); });
  }

  // Least and greatest of an accessor of floats, as the format asks of positions and times.
  void add_bounds(int accessor, int components) {
    tinygltf::Accessor& a = model_.accessors[static_cast<size_t>(accessor)];
    const auto& view = model_.bufferViews[static_cast<size_t>(a.bufferView)];
    a.minValues.assign(static_cast<size_t>(components), std::numeric_limits<double>::max());
    a.maxValues.assign(static_cast<size_t>(components), std::numeric_limits<double>::lowest());
    const unsigned char* from = model_.buffers[0].data.data() + view.byteOffset;
    for (size_t i = 0; i < a.count; ++i)
      for (size_t k = 0; k < static_cast<size_t>(components); ++k, from += sizeof(float)) {
        float value;
        std::memcpy(&value, from, sizeof(float));
        a.minValues[k] = std::min(a.minValues[k], double{value});
        a.maxValues[k] = std::max(a.maxValues[k], double{value});
      }
  }

  void write(const std::filesystem::path& path) {
    const uint64_t bytes = model_.buffers.empty() ? 0 : model_.buffers[0].data.size();
    // The file's length is a number of 32 bits.
    if (bytes > (uint64_t{1} << 32) - (1 << 20))
      throw Error("the mesh needs more than 4 GB, which no GLB file holds", path.string(),
                  "give --triangles or a smaller --resolution, or write .ply");
    write_file_atomically(path, [&](const std::filesystem::path& temporary) {
      std::ofstream out(temporary, std::ios::binary);
      tinygltf::TinyGLTF writer;
      const bool done = writer.WriteGltfSceneToStream(&model_, out, false, true);
      out.close();
      if (!done || !out) throw errno_error(errno, "cannot write the file", path);
    });
  }

 private:
  tinygltf::Model model_;
};

std::vector<double> numbers_of(const Vec3d& v) { return {v.x, v.y, v.z}; }
std::vector<double> numbers_of(const Quaternion& q) { return {q.x, q.y, q.z, q.w}; }

// A camera's pose in glTF: x right, y up, looking along -z.
Pose gltf_pose(const Pose& camera_to_world, const Similarity& input_to_gltf) {
  Pose pose = input_to_gltf.apply(camera_to_world);
  pose.rotation.set_column(1, -pose.rotation.column(1));
  pose.rotation.set_column(2, -pose.rotation.column(2));
  return pose;
}

void place(const Pose& pose, tinygltf::Node& node) {
  node.translation = numbers_of(pose.translation);
  node.rotation = numbers_of(to_quaternion(pose.rotation));
}

tinygltf::Value::Object lens_of(const Camera& camera) {
  tinygltf::Value::Object extras;
  extras["model"] = tinygltf::Value(std::string(camera_model_name(camera.model)));
  extras["width"] = tinygltf::Value(camera.width);
  extras["height"] = tinygltf::Value(camera.height);
  tinygltf::Value::Array params;
  for (int i = 0; i < camera_model_params(camera.model); ++i)
    params.emplace_back(camera.params[static_cast<size_t>(i)]);
  extras["params"] = tinygltf::Value(std::move(params));
  return extras;
}

int add_camera(const std::string& name, const Camera& camera, double near, GlbWriter& writer) {
  tinygltf::Camera added;
  added.name = name;
  added.type = "perspective";
  added.perspective.aspectRatio = camera.width / camera.fx() / (camera.height / camera.fy());
  added.perspective.yfov = 2 * std::atan(0.5 * camera.height / camera.fy());
  added.perspective.znear = near;
  added.perspective.zfar = 1e4 * near;  // without one tinygltf writes 0, which is not allowed
  writer.model().cameras.push_back(added);
  return static_cast<int>(writer.model().cameras.size()) - 1;
}

void add_path(const CameraPath& path, const Similarity& input_to_gltf, double near,
              GlbWriter& writer) {
  const PathFrame& first = path.frames.front();
  std::vector<Pose> poses;
  std::vector<Quaternion> turns;
  for (const PathFrame& frame : path.frames) {
    poses.push_back(gltf_pose(frame.camera_to_world, input_to_gltf));
    Quaternion q = to_quaternion(poses.back().rotation);
    // The shorter way round.
    if (!turns.empty()) {
      const Quaternion& p = turns.back();
      if (p.w * q.w + p.x * q.x + p.y * q.y + p.z * q.z < 0) q = {-q.w, -q.x, -q.y, -q.z};
    }
    turns.push_back(q);
  }
  tinygltf::Node node;
  node.name = "path";
  place(poses.front(), node);
  node.camera = add_camera("path", first.camera, near, writer);
  auto extras = lens_of(first.camera);
  extras["fps"] = tinygltf::Value(path.fps);
  node.extras = tinygltf::Value(std::move(extras));
  const int index = writer.add_node(node);
  const size_t n = poses.size();
  const int times = writer.add_floats(n, 1, TINYGLTF_TYPE_SCALAR, 0, [&](size_t i, int) {
    return static_cast<double>(i) / path.fps;
  });
  writer.add_bounds(times, 1);
  const int places = writer.add_floats(n, 3, TINYGLTF_TYPE_VEC3, 0,
                                       [&](size_t i, int k) { return poses[i].translation[k]; });
  const int rotations = writer.add_floats(n, 4, TINYGLTF_TYPE_VEC4, 0, [&](size_t i, int k) {
    return numbers_of(turns[i])[static_cast<size_t>(k)];
  });
  tinygltf::Animation animation;
  animation.name = "path";
  for (const auto& [target, output] :
       {std::pair{"translation", places}, std::pair{"rotation", rotations}}) {
    tinygltf::AnimationSampler sampler;
    sampler.input = times;
    sampler.output = output;
    sampler.interpolation = "LINEAR";
    animation.samplers.push_back(sampler);
    tinygltf::AnimationChannel channel;
    channel.sampler = static_cast<int>(animation.samplers.size()) - 1;
    channel.target_node = index;
    channel.target_path = target;
    animation.channels.push_back(channel);
  }
  writer.model().animations.push_back(animation);
}

}  // namespace

Similarity input_to_gltf(const ModelInfo& info, double metres) {
  return {metres, engine_to_gltf() * info.to_engine.rotation, info.to_engine.center};
}

void write_glb(const std::filesystem::path& path, const TriangleMesh& mesh,
               const Similarity& to_gltf, const Similarity& input_to_gltf) {
  GlbWriter writer(input_to_gltf);
  const size_t n = mesh.positions.size();
  tinygltf::Primitive primitive;
  primitive.mode = TINYGLTF_MODE_TRIANGLES;
  primitive.material = 0;
  primitive.attributes["POSITION"] =
      writer.add_floats(n, 3, TINYGLTF_TYPE_VEC3, TINYGLTF_TARGET_ARRAY_BUFFER,
                        [&, last = size_t(-1), p = Vec3d()](size_t i, int k) mutable {
                          if (i != last) p = to_gltf.apply(mesh.positions[i].cast<double>());
                          last = i;
                          return p[k];
                        });
  writer.add_bounds(primitive.attributes["POSITION"], 3);
  if (!mesh.normals.empty())
    primitive.attributes["NORMAL"] = writer.add_floats(
        n, 3, TINYGLTF_TYPE_VEC3, TINYGLTF_TARGET_ARRAY_BUFFER,
        [&](size_t i, int k) { return (to_gltf.rotation * mesh.normals[i].cast<double>())[k]; });
  tinygltf::Material material;
  material.name = "radiance";
  material.doubleSided = true;
  material.pbrMetallicRoughness.metallicFactor = 0;
  material.pbrMetallicRoughness.roughnessFactor = 1;
  if (!mesh.colours.empty()) {
    const int colours = writer.add_accessor<uint16_t>(
        n, 4, TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT, TINYGLTF_TYPE_VEC4,
        TINYGLTF_TARGET_ARRAY_BUFFER, [&](size_t i, int k) {
          const double x =
              k == 3
                  ? 1
                  : srgb_to_linear(std::clamp(static_cast<double>(mesh.colours[i][k]), 0.0, 1.0));
          return static_cast<uint16_t>(std::lround(x * 65535));
        });
    writer.model().accessors[static_cast<size_t>(colours)].normalized = true;
    primitive.attributes["COLOR_0"] = colours;
    material.extensions["KHR_materials_unlit"] = tinygltf::Value(tinygltf::Value::Object());
    writer.model().extensionsUsed.push_back("KHR_materials_unlit");
  }
  writer.model().materials.push_back(material);
  primitive.indices = writer.add_accessor<uint32_t>(
      mesh.triangles.size(), 3, TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT, TINYGLTF_TYPE_SCALAR,
      TINYGLTF_TARGET_ELEMENT_ARRAY_BUFFER,
      [&](size_t i, int k) { return mesh.triangles[i][static_cast<size_t>(k)]; });
  writer.model().accessors[static_cast<size_t>(primitive.indices)].count =
      3 * mesh.triangles.size();
  tinygltf::Mesh added;
  added.name = "surface";
  added.primitives.push_back(primitive);
  writer.model().meshes.push_back(added);
  tinygltf::Node node;
  node.name = "surface";
  node.mesh = 0;
  writer.add_node(node);
  writer.write(path);
}

std::vector<std::string> write_glb_cameras(const std::filesystem::path& path, const ModelInfo& info,
                                           const CameraPath& camera_path,
                                           const Similarity& input_to_gltf) {
  std::vector<std::string> notes;
  GlbWriter writer(input_to_gltf);
  const double near = std::max(1e-4, info.near / info.to_engine.scale * input_to_gltf.scale);
  size_t panoramas = 0, bent = 0;
  for (const ModelView& view : info.views) {
    if (view.held_out) continue;
    tinygltf::Node node;
    node.name = view.name;
    place(gltf_pose(view.pose, input_to_gltf), node);
    node.extras = tinygltf::Value(lens_of(view.camera));
    bent += camera_model_params(view.camera.model) > 4;
    if (is_panorama(view.camera))
      ++panoramas;
    else
      node.camera = add_camera(view.name, view.camera, near, writer);
    writer.add_node(node);
  }
  if (panoramas > 0)
    notes.push_back(fmt::format("{} panoramas became nodes without a camera", panoramas));
  if (bent > 0) notes.push_back("lens distortion has no place in glTF: it is in the nodes' extras");
  if (!camera_path.frames.empty()) {
    if (camera_path.picture != PictureKind::kPerspective)
      throw Error("glTF has no cameras that look all around", "--path", "give a perspective path");
    add_path(camera_path, input_to_gltf, near, writer);
  }
  writer.write(path);
  return notes;
}

}  // namespace nerf
