#include "stereo.h"

#include <algorithm>

#include "nerf/base/error.h"

namespace nerf::apps {
namespace {

Eye eye_at(PictureKind picture, const Eye& middle, double right) {
  NERF_CHECK(is_stereo(picture) && is_panorama(middle.camera));
  Eye eye = middle;
  if (picture == PictureKind::kOds)
    eye.camera.params[4] = right;
  else
    eye.camera_to_world.translation = middle.camera_to_world * Vec3d{right, 0, 0};
  return eye;
}

// Copies rows of `values` numbers a pixel to where the eye's picture stands.
template <class T>
void place(const std::vector<T>& from, int width, int height, size_t values, size_t first,
           size_t stride, std::vector<T>& to) {
  const size_t row = static_cast<size_t>(width) * values;
  for (size_t y = 0; y < static_cast<size_t>(height); ++y)
    std::copy_n(from.data() + y * row, row, to.data() + (first + y * stride) * values);
}

}  // namespace

Eye left_eye(PictureKind picture, const Eye& middle, double ipd) {
  return eye_at(picture, middle, -0.5 * ipd);
}

Eye right_eye(PictureKind picture, const Eye& middle, double ipd) {
  return eye_at(picture, middle, 0.5 * ipd);
}

Frame join_eyes(PictureKind picture, const Frame& left, const Frame& right) {
  NERF_CHECK(left.width == right.width && left.height == right.height);
  const bool over = picture == PictureKind::kOds;
  const size_t w = static_cast<size_t>(left.width), h = static_cast<size_t>(left.height);
  const size_t stride = over ? w : 2 * w;
  Frame out{over ? left.width : 2 * left.width, over ? 2 * left.height : left.height,
            std::vector<Real>(6 * w * h), std::vector<Real>(2 * w * h),
            std::vector<Real>(2 * w * h)};
  for (const Frame* eye : {&left, &right}) {
    const size_t first = eye == &left ? 0 : over ? w * h : w;
    place(eye->rgb, eye->width, eye->height, 3, first, stride, out.rgb);
    place(eye->alpha, eye->width, eye->height, 1, first, stride, out.alpha);
    place(eye->depth_z, eye->width, eye->height, 1, first, stride, out.depth_z);
    out.statistics += eye->statistics;
    for (const auto& [values, per_pixel] : kLayerArrays) {
      const std::vector<Real>& from = eye->layers.*values;
      std::vector<Real>& to = out.layers.*values;
      to.resize(2 * from.size());
      if (!from.empty()) place(from, eye->width, eye->height, per_pixel, first, stride, to);
    }
    out.layers.deep.resize(2 * eye->layers.deep.size());
    if (!eye->layers.deep.empty())
      place(eye->layers.deep, eye->width, eye->height, 1, first, stride, out.layers.deep);
  }
  return out;
}

}  // namespace nerf::apps
