#include "photo_conversion.h"

#include <OpenImageIO/imageio.h>
#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <mutex>
#include <set>

#include "image_decode.h"
#include "io/cameras/capture_photos.h"
#include "nerf/base/error.h"
#include "nerf/base/file.h"
#include "nerf/base/threads.h"
#include "nerf/io/image.h"
#include "paths.h"
#include "scene_input.h"
#include "staged_folder.h"

namespace nerf::internal {

namespace fs = std::filesystem;

namespace {

struct Plan {
  fs::path from;
  std::string name;  // in the prepared folder; of a converted photo without extension
  bool convert = false;
};

std::string without_extension(const std::string& name) {
  return fs::path(name).replace_extension().generic_string();
}

std::vector<Plan> plan_of(const fs::path& photos, const CaptureFolders& folders, int* twice) {
  std::vector<std::string> names;
  std::set<std::string> readable;
  for (std::string& name : capture_photo_names(photos, folders)) {
    const fs::path path = photos / name;
    if (!needs_conversion(path)) readable.insert(without_extension(name));
    names.push_back(std::move(name));
  }
  std::vector<Plan> plan;
  std::set<std::string> converted;
  for (const std::string& name : names) {
    const std::string stem = without_extension(name);
    if (!needs_conversion(name)) {
      plan.push_back({photos / name, name, false});
    } else if (readable.contains(stem) || !converted.insert(stem).second) {
      ++*twice;
    } else {
      plan.push_back({photos / name, stem, true});
    }
  }
  return plan;
}

std::string key_of(const std::vector<Plan>& plan) {
  std::string key;
  for (const Plan& p : plan) {
    std::error_code ignored;
    key += fmt::format("{} {} {}\n", fs::absolute(p.from).string(), fs::file_size(p.from, ignored),
                       fs::last_write_time(p.from, ignored).time_since_epoch().count());
  }
  return key;
}

// What the file says of how the photo was taken, for the focal length.
OIIO::ImageSpec metadata_of(const fs::path& path) {
  OIIO::ImageSpec metadata;
  const auto in = OIIO::ImageInput::open(path.string());
  if (!in) return metadata;
  for (const auto& attribute : in->spec().extra_attribs) {
    const std::string name = attribute.name().string();
    const bool exif = name == "Make" || name == "Model" || name == "FNumber" ||
                      name == "ExposureTime" || name == "DateTime" || name.starts_with("Exif:") ||
                      name.starts_with("GPS:");
    if (exif && !name.ends_with("PixelXDimension") && !name.ends_with("PixelYDimension") &&
        !name.ends_with("MakerNote"))
      metadata.attribute(name, attribute.type(), attribute.data());
  }
  return metadata;
}

void convert(const Plan& plan, const fs::path& folder) {
  const Image8 image = read_image_8bit(plan.from);
  fs::path to = folder / plan.name;
  if (image.channels % 2 == 0) {
    to += ".png";
    write_image(to, image);
    return;
  }
  to += ".jpg";
  OIIO::ImageSpec spec = metadata_of(plan.from);
  spec = [&] {
    OIIO::ImageSpec out(image.width, image.height, image.channels, OIIO::TypeDesc::UINT8);
    out.extra_attribs = spec.extra_attribs;
    out.attribute("Compression", "jpeg:97");
    return out;
  }();
  const auto out = OIIO::ImageOutput::create("jpeg");
  if (!out || !out->open(to.string(), spec) ||
      !out->write_image(OIIO::TypeDesc::UINT8, image.pixels.data()) || !out->close())
    throw Error("cannot write: " + (out ? out->geterror() : OIIO::geterror()), to.string());
}

}  // namespace

void link_or_copy_photo(const fs::path& photo, const fs::path& to) {
  std::error_code failed;
  fs::create_symlink(fs::weakly_canonical(photo), to, failed);
  if (!failed) return;
  fs::copy_file(photo, to, failed);  // some file systems have no links
  if (failed) throw errno_error(failed.value(), "cannot link or copy a photo to", to);
}

bool needs_conversion(const fs::path& photo) {
  static const std::set<std::string> kReadable{".jpg", ".jpeg", ".png", ".tif", ".tiff", ".exr",
                                               ".bmp", ".webp", ".hdr", ".ppm", ".tga"};
  return !kReadable.contains(lower_extension(photo));
}

fs::path prepared_photos(const fs::path& photos, const CaptureFolders& folders,
                         const std::function<void(const std::string&)>& progress,
                         const Cancel* cancel, std::vector<std::string>& notes) {
  int twice = 0;
  const std::vector<Plan> plan = plan_of(photos, folders, &twice);
  const auto converted = static_cast<int>(
      std::count_if(plan.begin(), plan.end(), [](const Plan& p) { return p.convert; }));
  if (converted == 0 && twice == 0) return photos;
  if (converted > 0)
    notes.push_back(fmt::format("{} of {} photos were converted for colmap, and are used so",
                                converted, plan.size()));
  if (twice > 0)
    notes.push_back(fmt::format("{} photos lie there in two formats and count once", twice));
  const std::string key = key_of(plan);
  const fs::path result = folders.work / "photos";
  if (StagedFolder::is_complete(result, key)) return result;

  make_writable_folder(folders.work);
  StagedFolder staged(result);
  for (const Plan& p : plan) fs::create_directories((staged.path() / p.name).parent_path());
  ThreadPool pool;
  std::mutex mutex;
  int done = 0;
  pool.parallel_for(static_cast<int64_t>(plan.size()), [&](int64_t i) {
    const Plan& p = plan[static_cast<size_t>(i)];
    if (cancel != nullptr && cancel->requested()) throw Cancelled();
    if (!p.convert) return link_or_copy_photo(p.from, staged.path() / p.name);
    convert(p, staged.path());
    const std::lock_guard lock(mutex);
    ++done;
    if (progress && (done % 10 == 0 || done == converted))
      progress(fmt::format("converted {} of {} photos for colmap", done, converted));
  });
  staged.commit(key);
  return result;
}

}  // namespace nerf::internal
