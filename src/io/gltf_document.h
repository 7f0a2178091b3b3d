// A glTF file in memory, with its numbers checked before they are believed.
#pragma once

#include <tiny_gltf.h>

#include <array>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace nerf::internal {

// The file read by tinygltf, images not decoded (Image::image holds the file's bytes). Throws
// Error.
tinygltf::Model load_gltf(const std::filesystem::path& path);

// The numbers of an accessor, converted as its type says (normalised integers to [-1, 1] or [0,
// 1]). Throws Error where they are not all in the file.
class GltfNumbers {
 public:
  // `what` names the accessor's use: "mesh 0, POSITION".
  GltfNumbers(const tinygltf::Model& model, int accessor, const std::string& what,
              const std::filesystem::path& path);

  size_t count() const { return count_; }
  int components() const { return components_; }
  bool integers() const { return type_ != TINYGLTF_COMPONENT_TYPE_FLOAT; }
  double number(size_t i, int component) const;
  uint32_t index(size_t i) const;  // of an accessor of unsigned integers

 private:
  const unsigned char* data_ = nullptr;
  size_t count_ = 0, stride_ = 0;
  int components_ = 1, type_ = 0, bytes_ = 1;
  bool normalised_ = false;
};

}  // namespace nerf::internal
