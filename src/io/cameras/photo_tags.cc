#include "io/cameras/photo_tags.h"

#include <OpenImageIO/imageio.h>
#include <fmt/format.h>

#include <cmath>

#include "nerf/io/image.h"

namespace nerf::internal {

namespace {

// Degrees of three numbers: degrees, minutes, seconds. No value where they are none.
std::optional<double> angle_of(const OIIO::ImageSpec& spec, const std::string& name,
                               const char* negative, double most) {
  const OIIO::ParamValue* value =
      spec.find_attribute(name, OIIO::TypeDesc(OIIO::TypeDesc::FLOAT, 3));
  if (!value) return {};
  const float* parts = static_cast<const float*>(value->data());
  const double degrees = static_cast<double>(parts[0]) + static_cast<double>(parts[1]) / 60 +
                         static_cast<double>(parts[2]) / 3600;
  if (!std::isfinite(degrees) || std::abs(degrees) > most) return {};
  return spec.get_string_attribute(name + "Ref").substr(0, 1) == negative ? -degrees : degrees;
}

}  // namespace

PhotoTags read_photo_tags(const std::filesystem::path& path) {
  const ImageInfo info = read_image_info(path);
  PhotoTags tags;
  tags.width = info.width;
  tags.height = info.height;
  const auto file = OIIO::ImageInput::open(path.string());
  if (!file) {
    OIIO::geterror();  // else it is kept for ever
    return tags;
  }
  const OIIO::ImageSpec& spec = file->spec();
  const int orientation = spec.get_int_attribute("Orientation", 1);
  if (orientation >= 1 && orientation <= 8) tags.orientation = orientation;
  const auto text = [&](const char* name) { return std::string(spec.get_string_attribute(name)); };
  if (!text("Make").empty() || !text("Model").empty()) {
    for (const char* name : {"Make", "Model", "Exif:BodySerialNumber", "Exif:LensModel"})
      tags.device += text(name) + "|";
    for (const char* name :
         {"Exif:FocalLength", "Exif:FocalLengthIn35mmFilm", "Exif:DigitalZoomRatio"})
      tags.device += fmt::format("{:g}|", spec.get_float_attribute(name));
  }
  const auto latitude = angle_of(spec, "GPS:Latitude", "S", 90);
  const auto longitude = angle_of(spec, "GPS:Longitude", "W", 180);
  // Where there is no reception some write zeros.
  if (latitude && longitude && (*latitude != 0 || *longitude != 0))
    tags.place = {*latitude, *longitude};
  return tags;
}

}  // namespace nerf::internal
