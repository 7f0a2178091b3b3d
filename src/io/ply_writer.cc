#include <fmt/format.h>

#include <bit>
#include <cmath>
#include <cstring>
#include <fstream>
#include <string>

#include "nerf/base/error.h"
#include "nerf/base/file.h"
#include "nerf/io/mesh_file.h"

namespace nerf {

namespace {

static_assert(std::endian::native == std::endian::little, "the file's bytes are those of memory");

// Bytes that go to the file some thousand at a time.
class Bytes {
 public:
  explicit Bytes(std::ofstream& out) : out_(out) {}
  ~Bytes() { flush(); }
  template <class T>
  void put(T value) {
    if (used_ + sizeof(T) > sizeof(buffer_)) flush();
    std::memcpy(buffer_ + used_, &value, sizeof(T));
    used_ += sizeof(T);
  }
  void flush() {
    out_.write(buffer_, static_cast<std::streamsize>(used_));
    used_ = 0;
  }

 private:
  std::ofstream& out_;
  char buffer_[1 << 16];
  size_t used_ = 0;
};

uint8_t to_byte(Real x) {
  return static_cast<uint8_t>(std::lround(std::fmin(std::fmax(x, 0.0_r), 1.0_r) * 255));
}

}  // namespace

void write_ply(const std::filesystem::path& path, const TriangleMesh& mesh,
               const Similarity& to_file) {
  Box3 box;
  for (const Vec3& p : mesh.positions) box.extend(to_file.apply(p.cast<double>()));
  double far = 0;
  for (int k = 0; !box.empty() && k < 3; ++k)
    far = std::max({far, std::fabs(box.min[k]), std::fabs(box.max[k])});
  // A float's steps at the farthest point are a millionth of the whole.
  const bool wide = !box.empty() && far * 0x1p-24 > 1e-6 * length(box.size());
  const char* const number = wide ? "double" : "float";
  std::string header = "ply\nformat binary_little_endian 1.0\ncomment coordinates of the capture\n";
  header += fmt::format("element vertex {}\n", mesh.positions.size());
  for (const char axis : {'x', 'y', 'z'}) header += fmt::format("property {} {}\n", number, axis);
  if (!mesh.normals.empty()) header += "property float nx\nproperty float ny\nproperty float nz\n";
  if (!mesh.colours.empty())
    header += "property uchar red\nproperty uchar green\nproperty uchar blue\n";
  if (!mesh.triangles.empty())
    header += fmt::format("element face {}\nproperty list uchar int vertex_indices\n",
                          mesh.triangles.size());
  header += "end_header\n";
  write_file_atomically(path, [&](const std::filesystem::path& temporary) {
    std::ofstream out(temporary, std::ios::binary);
    out << header;
    {
      Bytes bytes(out);
      for (size_t i = 0; i < mesh.positions.size(); ++i) {
        const Vec3d p = to_file.apply(mesh.positions[i].cast<double>());
        for (int k = 0; k < 3; ++k) wide ? bytes.put(p[k]) : bytes.put(static_cast<float>(p[k]));
        if (!mesh.normals.empty()) {
          const Vec3d n = to_file.rotation * mesh.normals[i].cast<double>();
          for (int k = 0; k < 3; ++k) bytes.put(static_cast<float>(n[k]));
        }
        if (!mesh.colours.empty())
          for (int k = 0; k < 3; ++k) bytes.put(to_byte(mesh.colours[i][k]));
      }
      for (const auto& triangle : mesh.triangles) {
        bytes.put(uint8_t{3});
        for (const uint32_t v : triangle) bytes.put(static_cast<int32_t>(v));
      }
    }
    out.close();
    if (!out) throw errno_error(errno, "cannot write the points", path);
  });
}

}  // namespace nerf
