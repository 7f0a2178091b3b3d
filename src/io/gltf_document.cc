#include "gltf_document.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <set>
#include <string_view>

#include "colmap.h"
#include "nerf/base/error.h"
#include "nerf/base/file.h"

namespace nerf::internal {

namespace {

namespace fs = std::filesystem;

constexpr uint64_t kMostBytes = uint64_t{2} << 30;  // of a file; tinygltf counts in 32 bits

std::string one_line(std::string text) {
  std::replace(text.begin(), text.end(), '\n', ' ');
  while (!text.empty() && text.back() == ' ') text.pop_back();
  return printable(text);
}

bool file_exists(const std::string& name, void*) {
  std::error_code ignored;
  return fs::is_regular_file(name, ignored);
}
std::string same_path(const std::string& name, void*) { return name; }
bool read_whole(std::vector<unsigned char>* out, std::string* problem, const std::string& name,
                void*) {
  try {
    *out = read_file(name, kMostBytes);
    return true;
  } catch (const Error& error) {
    if (problem) *problem += error.what();
    return false;
  }
}
bool write_nothing(std::string*, const std::string&, const std::vector<unsigned char>&, void*) {
  return false;
}

// Keeps the file's bytes: they are decoded where they are used.
bool keep_bytes(tinygltf::Image* image, const int, std::string*, std::string*, int, int,
                const unsigned char* bytes, int size, void*) {
  // tinygltf has not looked where a view ends: copy_views() does.
  if (image->bufferView < 0) image->image.assign(bytes, bytes + std::max(size, 0));
  return true;
}

// The bytes of pictures that lie in a buffer; false where one ends beyond it.
bool copy_views(tinygltf::Model& model) {
  for (tinygltf::Image& image : model.images) {
    if (image.bufferView < 0) continue;
    if (static_cast<size_t>(image.bufferView) >= model.bufferViews.size()) return false;
    const auto& view = model.bufferViews[static_cast<size_t>(image.bufferView)];
    if (view.buffer < 0 || static_cast<size_t>(view.buffer) >= model.buffers.size()) return false;
    const auto& data = model.buffers[static_cast<size_t>(view.buffer)].data;
    if (view.byteOffset > data.size() || view.byteLength > data.size() - view.byteOffset)
      return false;
    const auto* begin = data.data() + view.byteOffset;
    image.image.assign(begin, begin + view.byteLength);
  }
  return true;
}

bool known_extension(const std::string& name) {
  static const std::set<std::string> known{"KHR_materials_emissive_strength", "KHR_materials_unlit",
                                           "KHR_mesh_quantization", "KHR_texture_transform"};
  return known.contains(name);
}

// What tinygltf 2.7 takes without a look.
void check_document(const tinygltf::Model& model, const fs::path& path) {
  for (const std::string& name : model.extensionsRequired)
    if (!known_extension(name))
      throw Error("needs the extension " + printable(name) + ", which is not known here",
                  path.string(), "export the object without it (and without compression)");
  for (size_t i = 0; i < model.buffers.size(); ++i)
    if (model.buffers[i].data.empty())
      throw Error(fmt::format("buffer {} is missing", i), path.string(),
                  "copy the file together with those that it names, or export a GLB");
}

}  // namespace

std::vector<std::string> ignored_extensions(const tinygltf::Model& model) {
  std::set<std::string> ignored;
  for (const std::string& name : model.extensionsUsed)
    if (!known_extension(name)) ignored.insert(name);
  return {ignored.begin(), ignored.end()};
}

tinygltf::Model load_gltf(const fs::path& path) {
  const std::vector<uint8_t> bytes = read_file(path, kMostBytes);
  const std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  const size_t first = text.find_first_not_of(" \t\r\n\xef\xbb\xbf");
  const bool binary = text.starts_with("glTF");
  if (!binary && (first == text.npos || text[first] != '{'))
    throw Error("is not a glTF file", path.string(), "give a .glb or .gltf");
  tinygltf::TinyGLTF loader;
  loader.SetImageLoader(keep_bytes, nullptr);
  loader.SetFsCallbacks({file_exists, same_path, read_whole, write_nothing, nullptr});
  tinygltf::Model model;
  std::string problem, warning;
  bool good = false;
  try {
    const auto length = static_cast<unsigned>(bytes.size());
    good = binary ? loader.LoadBinaryFromMemory(&model, &problem, &warning, bytes.data(), length,
                                                path.parent_path().string())
                  : loader.LoadASCIIFromString(&model, &problem, &warning, text.data(), length,
                                               path.parent_path().string());
  } catch (const std::exception& error) {
    problem = error.what();
  }
  if (!good)
    throw Error("cannot read the glTF file: " + one_line(problem.empty() ? "damaged" : problem),
                path.string(), kExportAgain);
  if (!copy_views(model))
    throw Error("a picture ends beyond its buffer", path.string(), kExportAgain);
  check_document(model, path);
  return model;
}

GltfNumbers::GltfNumbers(const tinygltf::Model& model, int accessor, const std::string& what,
                         const fs::path& path, bool zeros) {
  const auto fail = [&](const std::string& problem) {
    throw Error(what + ": " + problem, path.string(), kExportAgain);
  };
  const auto has = [](const auto& list, int i) {
    return i >= 0 && static_cast<size_t>(i) < list.size();
  };
  if (!has(model.accessors, accessor)) fail("there is no such accessor");
  const tinygltf::Accessor& a = model.accessors[static_cast<size_t>(accessor)];
  const auto bytes_of = [&](int type) {
    const std::set<int> types{
        TINYGLTF_COMPONENT_TYPE_BYTE,           TINYGLTF_COMPONENT_TYPE_SHORT,
        TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE,  TINYGLTF_COMPONENT_TYPE_FLOAT,
        TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT, TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT};
    if (!types.contains(type)) fail("numbers of an unknown type");
    return tinygltf::GetComponentSizeInBytes(static_cast<uint32_t>(type));
  };
  const auto elements = [&](int index, size_t offset, size_t element, size_t count) {
    if (!has(model.bufferViews, index)) fail("the accessor has no data");
    const tinygltf::BufferView& view = model.bufferViews[static_cast<size_t>(index)];
    if (!has(model.buffers, view.buffer)) fail("there is no such buffer");
    const auto& data = model.buffers[static_cast<size_t>(view.buffer)].data;
    const size_t stride = view.byteStride == 0 ? element : view.byteStride;
    // Each sum below stays far from what 64 bits hold, since each term is checked against the file.
    const size_t size = data.size();
    if (view.byteOffset > size || view.byteLength > size - view.byteOffset)
      fail("the buffer view ends behind its buffer");
    if (stride < element) fail("elements overlap");
    if (offset > view.byteLength || element > view.byteLength - offset ||
        (count - 1) > (view.byteLength - offset - element) / stride)
      fail(fmt::format("says {} elements, more than its buffer view holds", count));
    return Elements{data.data() + view.byteOffset + offset, stride};
  };
  type_ = a.componentType;
  bytes_ = bytes_of(type_);
  normalised_ = a.normalized;
  components_ = a.type == TINYGLTF_TYPE_SCALAR ? 1 : a.type == TINYGLTF_TYPE_MAT4 ? 16 : a.type;
  if ((components_ < 1 || components_ > 4) && components_ != 16)
    fail("is no list of numbers, vectors or 4x4 matrices");
  const size_t element = static_cast<size_t>(bytes_ * components_);
  count_ = a.count;
  if (count_ == 0) fail("the accessor is empty");
  if (!a.sparse.isSparse || a.bufferView >= 0 || !zeros)
    all_ = elements(a.bufferView, a.byteOffset, element, count_);
  if (!a.sparse.isSparse) return;
  const auto offset = [&](int bytes) {
    if (bytes < 0) fail("a sparse accessor begins before its buffer view");
    return static_cast<size_t>(bytes);
  };
  if (a.sparse.count < 1) fail("a sparse accessor without elements");
  sparse_count_ = static_cast<size_t>(a.sparse.count);
  const int type = a.sparse.indices.componentType;
  sparse_bytes_ = bytes_of(type);
  if (type != TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE &&
      type != TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT &&
      type != TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT)
    fail("a sparse accessor's indices are no whole numbers");
  sparse_indices_ = elements(a.sparse.indices.bufferView, offset(a.sparse.indices.byteOffset),
                             static_cast<size_t>(sparse_bytes_), sparse_count_);
  sparse_values_ = elements(a.sparse.values.bufferView, offset(a.sparse.values.byteOffset), element,
                            sparse_count_);
  for (size_t i = 0; i < sparse_count_; ++i)
    if (sparse_index(i) >= count_ || (i > 0 && sparse_index(i) <= sparse_index(i - 1)))
      fail("a sparse accessor's indices do not rise to its last element");
}

uint32_t GltfNumbers::sparse_index(size_t i) const {
  uint32_t value = 0;  // little-endian, as the file
  std::memcpy(&value, sparse_indices_.at(i), static_cast<size_t>(sparse_bytes_));
  return value;
}

const unsigned char* GltfNumbers::at(size_t i) const {
  size_t low = 0, high = sparse_count_;
  while (low < high) {
    const size_t middle = (low + high) / 2;
    if (sparse_index(middle) < i)
      low = middle + 1;
    else
      high = middle;
  }
  if (low < sparse_count_ && sparse_index(low) == i) return sparse_values_.at(low);
  return all_.data == nullptr ? nullptr : all_.at(i);
}

double GltfNumbers::number(size_t i, int component) const {
  const unsigned char* at = this->at(i);
  if (at == nullptr) return 0;
  at += component * bytes_;
  const auto as = [&]<class T>(T value, double full) {
    std::memcpy(&value, at, sizeof(T));
    if (!normalised_) return static_cast<double>(value);
    return std::max(static_cast<double>(value) / full, -1.0);
  };
  switch (type_) {
    case TINYGLTF_COMPONENT_TYPE_BYTE:
      return as(int8_t{}, 127);
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE:
      return as(uint8_t{}, 255);
    case TINYGLTF_COMPONENT_TYPE_SHORT:
      return as(int16_t{}, 32767);
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT:
      return as(uint16_t{}, 65535);
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT:
      return as(uint32_t{}, 4294967295.0);
    default:
      break;
  }
  float value;
  std::memcpy(&value, at, sizeof(float));
  return double{value};
}

uint32_t GltfNumbers::index(size_t i, int component) const {
  const unsigned char* at = this->at(i);
  uint32_t value = 0;  // little-endian, as the file
  if (at != nullptr) std::memcpy(&value, at + component * bytes_, static_cast<size_t>(bytes_));
  return value;
}

}  // namespace nerf::internal
