// Pixels of the training photos and their rays.
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <iterator>
#include <map>

#include "nerf/base/error.h"
#include "train/free_space.h"
#include "train/ray_batch.h"

namespace nerf {

PixelSource::PixelSource(const Scene& scene, const PhotoSet& photos, double sighting_share)
    : photos_(photos), views_(scene.train) {
  if (sighting_share > 0) sightings_ = sightings_of(scene, photos);
  if (!sightings_.empty()) sighting_share_ = static_cast<Real>(sighting_share);
  sightings_of_photo_.resize(views_.size());
  for (size_t i = 0; i < sightings_.size(); ++i)
    sightings_of_photo_[sightings_[i].source].push_back(i);
  const std::vector<double> near = near_of_views(scene);
  pixels_before_.push_back(0);
  double weight = 0;
  std::map<std::filesystem::path, int> files;  // a scene that a program made may have names alone
  for (int v : views_) {
    const Photo& p = photos.photos[static_cast<size_t>(v)];
    pixels_before_.push_back(pixels_before_.back() +
                             static_cast<uint64_t>(p.width) * static_cast<uint64_t>(p.height));
    const View& view = scene.views[static_cast<size_t>(v)];
    poses_.push_back(scene.to_engine.apply(view.pose));
    cameras_.push_back(photos.cameras[static_cast<size_t>(v)]);
    near_.push_back(near[static_cast<size_t>(v)]);
    times_.push_back(static_cast<Real>(view.time));
    has_depth_ = has_depth_ || !p.depth.empty();
    const std::filesystem::path file =
        view.image_path.empty() ? std::filesystem::path(view.name) : view.image_path;
    const auto [known, is_new] = files.try_emplace(file, static_cast<int>(files.size()));
    files_.push_back(known->second);
    if (is_new) file_names_.push_back(view.name);
    weights_.push_back(static_cast<Real>(view.scale * view.scale));
    weight += static_cast<double>(weights_.back()) *
              static_cast<double>(pixels_before_.back() - pixels_before_[poses_.size() - 1]);
  }
  if (pixels_before_.back() == 0) throw Error("no photo to train on", scene.root.string());
  mean_weight_ = weight / static_cast<double>(pixels_before_.back());
  const auto keeps_any = [&](int v) {
    const Photo& photo = photos.photos[static_cast<size_t>(v)];
    return photo.mask.empty() || std::ranges::any_of(photo.mask, [](uint8_t m) { return m != 0; });
  };
  if (std::ranges::none_of(views_, keeps_any))
    throw Error("the masks leave no pixel to train on", scene.root.string(),
                "values of 128 and more keep a pixel: are the masks inverted?");
}

bool PixelSource::draw(Random& random, Pixel& out) const {
  return locate(random, out) && read(out);
}

bool PixelSource::wants_point(Random& random) const {
  return sighting_share_ > 0 && random.uniform() < sighting_share_;
}

bool PixelSource::wants_masked(Random& random, const Photo& photo) const {
  return masked_share_ > 0 && !photo.mask.empty() && random.uniform() < masked_share_;
}

// A place in one of the photos: each pixel as often as the others, of a panorama each solid angle.
void PixelSource::choose(Random& random, Pixel& out) const {
  out.distance = 0;
  if (wants_point(random)) {
    const Sighting& seen = sightings_[static_cast<size_t>(random.below(sightings_.size()))];
    out.source = seen.source;
    out.photo = &photos_.photos[static_cast<size_t>(views_[seen.source])];
    out.show(seen);
    return;
  }
  for (;;) {
    const uint64_t at = random.below(pixels_before_.back());
    out.source =
        static_cast<size_t>(std::upper_bound(pixels_before_.begin(), pixels_before_.end(), at) -
                            pixels_before_.begin() - 1);
    const size_t view = static_cast<size_t>(views_[out.source]);
    out.photo = &photos_.photos[view];
    const uint64_t pixel = at - pixels_before_[out.source];
    const uint64_t width = static_cast<uint64_t>(out.photo->width);
    out.x = static_cast<int>(pixel % width);
    out.y = static_cast<int>(pixel / width);
    // The poles of a panorama are many pixels and little to see.
    const Camera& camera = photos_.cameras[view];
    if (!is_panorama(camera)) return;
    if (static_cast<double>(random.uniform()) < relative_solid_angle(camera, out.y + 0.5)) return;
  }
}

bool PixelSource::locate(Random& random, Pixel& out) const {
  choose(random, out);
  out.masked = wants_masked(random, *out.photo);
  return cast(out);
}

bool PixelSource::draw_from(size_t i, Random& random, double share, Pixel& out) const {
  out.source = i;
  out.photo = &photos_.photos[static_cast<size_t>(views_[i])];
  out.distance = 0;
  const std::vector<size_t>& seen = sightings_of_photo_[i];
  // Points are anywhere in a photo.
  if (share == 1 && !seen.empty() && wants_point(random)) {
    out.show(sightings_[seen[static_cast<size_t>(random.below(seen.size()))]]);
  } else {
    const auto within = [&](int size) {
      const int middle = std::max(1, static_cast<int>(share * size));
      return (size - middle) / 2 + static_cast<int>(random.below(static_cast<uint64_t>(middle)));
    };
    out.x = within(out.photo->width);
    out.y = within(out.photo->height);
  }
  out.masked = wants_masked(random, *out.photo);
  return cast(out) && read(out);
}

// The ray of a pixel whose photo and place are known.
bool PixelSource::cast(Pixel& out) const {
  const size_t i = out.source;
  const Photo& photo = *out.photo;
  photo.prefetch(out.x, out.y);
  out.camera = &cameras_[i];
  out.weight = weights_[i];
  out.pose = &poses_[i];
  const auto ray = camera_ray(*out.camera, poses_[i], out.centre());
  if (!ray) return false;
  out.ray = *ray;
  out.ray.near = near_[i];
  out.ray.time = times_[i];
  out.ray.photo = files_[i];
  if (has_depth_)
    out.along_axis =
        is_panorama(*out.camera) ? 1 : dot(ray->direction, poses_[i].rotation.column(2));
  return true;
}

bool PixelSource::read(Pixel& out) const {
  if (!read_colour(out)) return false;
  if (out.distance > 0 || out.masked || !has_depth_ || !(out.along_axis > 0)) return true;
  const Vec2d centre = out.centre();
  out.distance = out.photo->depth.at(centre.x / out.photo->width, centre.y / out.photo->height) /
                 out.along_axis;
  return true;
}

bool PixelSource::read_colour(Pixel& out) const {
  const bool drawn = out.masked;  // where it is
  out.masked = out.photo->masked_out(out.x, out.y);
  if (out.masked) {
    out.alpha = 0;
    out.ray.photo = -1;
    return drawn;
  }
  Real rgba[4];
  out.photo->pixel(out.x, out.y, rgba);
  std::copy(rgba, rgba + 3, out.rgb);
  out.alpha = rgba[3];
  return true;
}

}  // namespace nerf
