// What other programs are given: read back by tinygltf, by the reader of point clouds, byte by
// byte.
#include "nerf/io/mesh_file.h"

#include <gtest/gtest.h>
#include <tiny_gltf.h>

#include <cmath>
#include <cstring>
#include <numbers>

#include "io/ply.h"
#include "nerf/base/file.h"
#include "nerf/io/object_file.h"
#include "nerf/math/srgb.h"
#include "support/cameras.h"
#include "support/temp_folder.h"

namespace nerf {
namespace {

TriangleMesh some_mesh() {
  TriangleMesh mesh;
  mesh.positions = {{0, 0, 0}, {1, 0, 0}, {0, 2, 0}, {0, 0, 3}};
  mesh.triangles = {{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}};
  mesh.colours = {{0, 0.25_r, 1}, {0.5_r, 0.5_r, 0.5_r}, {1, 1, 1}, {0.1_r, 0.2_r, 0.3_r}};
  find_normals(mesh);
  return mesh;
}

// Engine axes turned by 90 degrees about the input's x: the input's -y is up.
ModelInfo some_capture() {
  ModelInfo info;
  info.to_engine.scale = 0.5;
  info.to_engine.rotation.m = {{{1, 0, 0}, {0, 0, 1}, {0, -1, 0}}};
  info.to_engine.center = {10, 20, 30};
  info.near = 0.1;
  return info;
}

TEST(InputToGltf, StandsUpright) {
  const Similarity s = input_to_gltf(some_capture(), 2);
  EXPECT_EQ(s.apply(Vec3d{10, 20, 30}), Vec3d());
  const Vec3d above = s.apply(Vec3d{10, 19, 30});
  EXPECT_NEAR(above.y, 2, 1e-12);
  EXPECT_NEAR(length(above), 2, 1e-12);
}

TEST(WriteGlb, IsReadAsItWas) {
  const test::TempFolder folder;
  const auto file = folder / "mesh.glb";
  const TriangleMesh mesh = some_mesh();
  const Similarity to_gltf = input_to_gltf(some_capture(), 2);
  write_glb(file, mesh, to_gltf, to_gltf);
  const ReadObject read = read_object(file);
  EXPECT_TRUE(read.notes.empty());
  const SceneObject& o = read.object;
  EXPECT_EQ(o.mesh.triangles, mesh.triangles);
  ASSERT_EQ(o.mesh.positions.size(), mesh.positions.size());
  for (size_t i = 0; i < mesh.positions.size(); ++i) {
    EXPECT_LT(length(o.mesh.positions[i].cast<double>() -
                     to_gltf.apply(mesh.positions[i].cast<double>())),
              1e-5);
    EXPECT_LT(length(o.mesh.normals[i].cast<double>() -
                     to_gltf.rotation * mesh.normals[i].cast<double>()),
              1e-6);
    for (size_t k = 0; k < 3; ++k)
      EXPECT_NEAR(o.colours[i][k],
                  srgb_to_linear(static_cast<double>(mesh.colours[i][static_cast<int>(k)])), 1e-5);
  }
  EXPECT_TRUE(o.materials[0].unlit);
}

TEST(WriteGlb, KeepsToTheFormat) {
  const test::TempFolder folder;
  const auto file = folder / "mesh.glb";
  const Similarity to_gltf = input_to_gltf(some_capture());
  write_glb(file, some_mesh(), to_gltf, to_gltf);
  const auto bytes = read_file(file);
  const auto word = [&](size_t at) {
    uint32_t w;
    std::memcpy(&w, bytes.data() + at, 4);
    return w;
  };
  EXPECT_EQ(word(0), 0x46546c67u);  // "glTF"
  EXPECT_EQ(word(4), 2u);
  EXPECT_EQ(word(8), bytes.size());
  EXPECT_EQ(word(12) % 4, 0u);
  EXPECT_EQ(word(16), 0x4e4f534au);                 // "JSON"
  EXPECT_EQ(word(20 + word(12) + 4), 0x004e4942u);  // "BIN"
  tinygltf::Model model;
  std::string problem, warning;
  ASSERT_TRUE(tinygltf::TinyGLTF().LoadBinaryFromFile(&model, &problem, &warning, file.string()));
  EXPECT_EQ(problem + warning, "");
  EXPECT_EQ(model.asset.extras.Get("up").Get<std::string>(), "+Y");
  // Column by column; the last one is where the input's origin is.
  const auto& matrix = model.asset.extras.Get("input_to_gltf");
  const Vec3d origin = to_gltf.apply(Vec3d{});
  for (int k = 0; k < 3; ++k) EXPECT_NEAR(matrix.Get(12 + k).GetNumberAsDouble(), origin[k], 1e-9);
  const auto& positions =
      model.accessors[static_cast<size_t>(model.meshes[0].primitives[0].attributes.at("POSITION"))];
  ASSERT_EQ(positions.minValues.size(), 3u);
  EXPECT_LT(positions.minValues[0], positions.maxValues[0]);
}

TEST(WritePly, KeepsTheInputsCoordinates) {
  const test::TempFolder folder;
  const TriangleMesh mesh = some_mesh();
  for (const double offset : {0.0, 4e6}) {
    SCOPED_TRACE(offset);
    Similarity to_file;
    to_file.center = {-offset, 0, 0};
    write_ply(folder / "mesh.ply", mesh, to_file);
    const std::string text = test::read_text(folder / "mesh.ply");
    EXPECT_TRUE(test::contains(text, offset > 0 ? "property double x" : "property float x"));
    EXPECT_TRUE(test::contains(text, "element face 4"));
    const auto read = internal::read_ply_points(folder / "mesh.ply");
    ASSERT_EQ(read.positions.size(), mesh.positions.size());
    for (size_t i = 0; i < mesh.positions.size(); ++i)
      EXPECT_LT(length(read.positions[i] - to_file.apply(mesh.positions[i].cast<double>())), 1e-6);
    // The header, then so many bytes for each vertex and each face.
    const size_t body = text.size() - (text.find("end_header\n") + 11);
    EXPECT_EQ(body, 4 * ((offset > 0 ? 24 : 12) + 12 + 3) + 4 * (1 + 12));
  }
}

TEST(WriteGlbCameras, LookWhereTheTrainingCamerasLook) {
  const test::TempFolder folder;
  ModelInfo info = some_capture();
  ModelView view;
  view.name = "a.jpg";
  view.camera = test::pinhole(80, 60, 50);
  view.pose.rotation.m = {{{0, 0, 1}, {0, 1, 0}, {-1, 0, 0}}};  // looks along x
  view.pose.translation = {11, 20, 30};
  info.views = {view, view};
  info.views[1].name = "held.jpg";
  info.views[1].held_out = true;
  CameraPath path;
  for (int i = 0; i < 3; ++i)
    path.frames.push_back({"p", view.camera, {view.pose.rotation, {11, 20.0 + i, 30}}, 0});
  const Similarity to_gltf = input_to_gltf(info);
  write_glb_cameras(folder / "c.glb", info, path, to_gltf);
  tinygltf::Model model;
  std::string problem, warning;
  ASSERT_TRUE(tinygltf::TinyGLTF().LoadBinaryFromFile(&model, &problem, &warning,
                                                      (folder / "c.glb").string()));
  EXPECT_EQ(problem + warning, "");
  ASSERT_EQ(model.nodes.size(), 2u);  // the training view, and the path
  const tinygltf::Node& node = model.nodes[0];
  EXPECT_EQ(node.name, "a.jpg");
  const tinygltf::Camera& camera = model.cameras[static_cast<size_t>(node.camera)];
  EXPECT_NEAR(camera.perspective.yfov, 2 * std::atan(30 / 50.0), 1e-12);
  EXPECT_NEAR(camera.perspective.aspectRatio, 80 / 60.0, 1e-12);
  EXPECT_GT(camera.perspective.zfar, camera.perspective.znear);
  // A quaternion's rotation of -z.
  const double x = node.rotation[0], y = node.rotation[1], z = node.rotation[2],
               w = node.rotation[3];
  const Vec3d forward{-2 * (x * z + w * y), -2 * (y * z - w * x), -(1 - 2 * (x * x + y * y))};
  EXPECT_LT(length(forward - to_gltf.rotation * Vec3d{1, 0, 0}), 1e-9);
  const Vec3d at = to_gltf.apply(view.pose.translation);
  EXPECT_LT(length(Vec3d{node.translation[0], node.translation[1], node.translation[2]} - at),
            1e-9);
  ASSERT_EQ(model.animations.size(), 1u);
  EXPECT_EQ(model.animations[0].channels.size(), 2u);
  const auto& times = model.accessors[static_cast<size_t>(model.animations[0].samplers[0].input)];
  EXPECT_NEAR(times.maxValues[0], 2 / path.fps, 1e-6);
}

TEST(WriteGlb, WritesNothingWhereItCannot) {
  const test::TempFolder folder;
  const Similarity s;
  EXPECT_NE(test::error_of([&] { write_glb(folder / "no" / "a.glb", some_mesh(), s, s); }), "");
  EXPECT_NE(test::error_of([&] { write_ply(folder / "no" / "a.ply", some_mesh(), s); }), "");
  EXPECT_EQ(folder.files(), 0);
}

}  // namespace
}  // namespace nerf
