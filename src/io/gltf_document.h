// A glTF file in memory, with its numbers checked before they are believed.
#pragma once

#include <tiny_gltf.h>

#include <array>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "nerf/math/vec.h"

namespace nerf::internal {

// The remedy for a file whose numbers or parts do not fit together.
inline constexpr const char* kExportAgain = "export the file again";

// Extensions that the file uses and this reader does not know; it reads on without them.
std::vector<std::string> ignored_extensions(const tinygltf::Model& model);

// The file read by tinygltf, images not decoded (Image::image holds the file's bytes). Throws
// Error.
tinygltf::Model load_gltf(const std::filesystem::path& path);

// The numbers of an accessor, converted as its type says (normalised integers to [-1, 1] or [0,
// 1]), sparse ones too. Throws Error where they are not all in the file.
class GltfNumbers {
 public:
  // `what` names the accessor's use: "mesh 0, POSITION". zeros: of a sparse accessor without a
  // buffer view what it does not name is 0; else the file must hold every element, so that memory
  // for all of them may be asked for.
  GltfNumbers(const tinygltf::Model& model, int accessor, const std::string& what,
              const std::filesystem::path& path, bool zeros = false);

  size_t count() const { return count_; }
  int components() const { return components_; }  // 16 of a 4x4 matrix, column by column
  bool integers() const { return type_ != TINYGLTF_COMPONENT_TYPE_FLOAT; }
  bool normalised() const { return normalised_; }
  double number(size_t i, int component) const;
  Vec3d vector(size_t i) const { return {number(i, 0), number(i, 1), number(i, 2)}; }
  uint32_t index(size_t i, int component = 0) const;  // of an accessor of unsigned integers

 private:
  // Elements one after the other in a buffer.
  struct Elements {
    const unsigned char* data = nullptr;
    size_t stride = 0;
    const unsigned char* at(size_t i) const { return data + i * stride; }
  };
  const unsigned char* at(size_t i) const;  // null: zero
  uint32_t sparse_index(size_t i) const;

  Elements all_, sparse_values_, sparse_indices_;
  size_t count_ = 0, sparse_count_ = 0;
  int components_ = 1, type_ = 0, bytes_ = 1, sparse_bytes_ = 0;
  bool normalised_ = false;
};

}  // namespace nerf::internal
