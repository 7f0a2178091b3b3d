#include "nerf/train/evaluation.h"

#include <algorithm>
#include <chrono>
#include <future>
#include <iterator>
#include <map>
#include <set>

#include "nerf/base/error.h"
#include "nerf/base/file.h"
#include "nerf/base/spread.h"
#include "nerf/base/text.h"
#include "nerf/io/depth_image.h"
#include "nerf/model/field.h"
#include "nerf/train/metrics.h"
#include "train/camera_fit.h"
#include "train/lens_picture.h"
#include "train/lenses.h"
#include "train/photo_fit.h"

namespace nerf {
namespace {

namespace fs = std::filesystem;

// Some of the views, spread evenly; 0: all.
std::vector<int> chosen(const std::vector<int>& views, int most) {
  std::vector<int> out;
  for (const size_t i :
       spread_evenly(views.size(), most > 0 ? static_cast<size_t>(most) : views.size()))
    out.push_back(views[i]);
  return out;
}

// One file per view in one folder: "images/a 1.jpg" gives "images_a 1.png".
fs::path picture_file(const std::string& view, std::set<std::string>& used) {
  std::string stem = fs::path(view).replace_extension().string();
  std::replace(stem.begin(), stem.end(), '/', '_');
  stem = shortened(std::move(stem), kLongestFileStem);
  std::string name = stem;
  for (int i = 2; name.empty() || !used.insert(name).second; ++i)
    name = stem + "_" + std::to_string(i);
  return name + ".png";
}

Image8 to_picture(const Frame& frame) {
  return to_8bit(ImageF{frame.width, frame.height, 3, frame.rgb});
}

void paste(const Image8& from, int x0, Image8& to) {
  const size_t row = static_cast<size_t>(from.width) * 3;
  for (int y = 0; y < from.height; ++y)
    std::copy_n(from.pixels.begin() + static_cast<ptrdiff_t>(static_cast<size_t>(y) * row), row,
                to.pixels.begin() + (static_cast<ptrdiff_t>(y) * to.width + x0) * 3);
}

// A photo's mask without what its light was fitted to.
std::vector<uint8_t> right_half(const Photo& photo) {
  const size_t width = static_cast<size_t>(photo.width), height = static_cast<size_t>(photo.height);
  std::vector<uint8_t> mask = photo.mask;
  if (mask.empty()) mask.assign(width * height, 255);
  for (size_t y = 0; y < height; ++y)
    std::fill_n(mask.begin() + static_cast<ptrdiff_t>(y * width), fitted_columns(photo.width),
                uint8_t{0});
  return mask;
}

// Mean of the values that are there; 0 where none is.
double mean(const std::vector<ViewScore>& views, std::optional<double> ViewScore::* value) {
  double sum = 0;
  int count = 0;
  for (const ViewScore& v : views)
    if (v.*value) {
      sum += *(v.*value);
      ++count;
    }
  return count > 0 ? sum / count : 0;
}

template <class Score>
Score mean_score(const std::vector<ViewScore>& of) {
  Score s;
  s.psnr = mean(of, &ViewScore::psnr);
  s.ssim = mean(of, &ViewScore::ssim);
  s.counted = static_cast<int>(
      std::ranges::count_if(of, [](const ViewScore& v) { return v.psnr.has_value(); }));
  return s;
}

// A photo's own camera, as it moved while the photo was read by what the model knows; with the lens
// that the model has for it where that is asked for and there is one.
Camera camera_of(const ModelInfo& info, const std::string& name, const Camera& own,
                 bool models_lens) {
  Camera camera = own;
  for (const ModelView& view : info.views) {
    if (view.name != name) continue;
    if (models_lens && view.camera.width == own.width && view.camera.height == own.height)
      camera = view.camera;
    camera.motion = view.motion;
    break;
  }
  return camera;
}

}  // namespace

Vec3 evaluation_background(const ModelInfo& info) {
  return info.alpha ? info.background : Vec3{0.5_r, 0.5_r, 0.5_r};
}

Image8 photo_over(const Photo& photo, const Vec3& background) {
  ImageF image{photo.width, photo.height, 3, {}};
  image.pixels.resize(3 * static_cast<size_t>(photo.width) * static_cast<size_t>(photo.height));
  for (int y = 0; y < photo.height; ++y)
    for (int x = 0; x < photo.width; ++x) {
      Real rgba[4];
      photo.pixel(x, y, rgba);
      for (int k = 0; k < 3; ++k)
        image.at(x, y)[k] = rgba[k] * rgba[3] + background[k] * (1 - rgba[3]);
    }
  return to_8bit(image);
}

Image8 side_by_side(const Image8& photo, const std::vector<uint8_t>& mask, const Image8& rendering,
                    const Frame& frame, const DepthRange& range) {
  NERF_CHECK(photo.width == rendering.width && photo.height == rendering.height);
  Image8 shown = photo;
  for (size_t i = 0; i < mask.size(); ++i)
    if (mask[i] == 0)
      for (size_t k = 0; k < 3; ++k) shown.pixels[3 * i + k] /= 4;
  const Image8 depth = depth_image(frame.width, frame.height, frame.depth_z, frame.alpha, range);
  Image8 out{3 * photo.width + 2 * kPictureGap, photo.height, 3, {}};
  out.pixels.assign(3 * static_cast<size_t>(out.width) * static_cast<size_t>(out.height), 255);
  paste(shown, 0, out);
  paste(rendering, photo.width + kPictureGap, out);
  paste(depth, 2 * (photo.width + kPictureGap), out);
  return out;
}

Evaluation evaluate(const RadianceField& model, const Scene& scene, const PhotoSet& photos,
                    const EvaluationOptions& options, ThreadPool& pool,
                    const std::function<void(double)>& progress, const Cancel* cancel) {
  const auto begin = std::chrono::steady_clock::now();
  const std::vector<int> views = chosen(scene.test, options.max_views);
  uint64_t pixels = 0;
  for (const int v : views) {
    const Camera& camera = photos.cameras[static_cast<size_t>(v)];
    pixels += static_cast<uint64_t>(camera.width) * static_cast<uint64_t>(camera.height);
  }
  RadianceField field = model;
  field.bake(pixels, pool, cancel);
  if (!options.pictures.empty()) make_writable_folder(options.pictures);
  RenderOptions render_options;
  render_options.background = evaluation_background(model.info());
  render_options.precision = options.precision;
  Evaluation result;
  result.halves = options.fit_light == FitLight::kOn ||
                  (options.fit_light == FitLight::kAuto && model.field().codes().has_own_light());
  std::set<std::string> used;
  // One view's picture is written while the next is drawn: encoding takes one thread only.
  std::future<void> writing;
  const std::vector<HeldOut> kinds = held_out_kinds(scene);
  const CodeBooks& books = model.field().codes();
  const bool has_falloff = books.falloff.out > 0;
  const Lenses lenses = has_falloff ? lenses_of(scene) : Lenses();
  for (size_t i = 0; i < views.size(); ++i) {
    const size_t v = static_cast<size_t>(views[i]);
    const Photo& photo = photos.photos[v];
    Falloff falloff{};
    Photo clear;  // what is fitted: the model has no lens
    if (has_falloff) {
      if (const int lens = lenses.of_view[v]; lens >= 0)
        falloff =
            falloff_of(books, model.field().all_weights(), lenses.names[static_cast<size_t>(lens)]);
      clear = without_falloff(photo, photos.cameras[v], falloff);
    }
    const Photo& fitted = has_falloff ? clear : photo;
    const auto draw = [&](const Camera& lens, const Pose& pose,
                          const std::function<void(double)>& progress_of) {
      Frame picture = render(field, lens, pose, render_options, pool, progress_of, cancel);
      if (has_falloff) add_falloff(lens, falloff, render_options.background, picture);
      return picture;
    };
    const auto at = [&](double f) {
      if (progress) progress((static_cast<double>(i) + f) / static_cast<double>(views.size()));
    };
    render_options.time = static_cast<Real>(scene.views[v].time);
    const Camera camera =
        camera_of(model.info(), scene.views[v].name, photos.cameras[v], options.align);
    if (!result.halves && model.field().codes().camera.out > 0)
      render_options.appearance.code =
          model.field().default_code(render_options.time, scene.views[v].ids.camera);
    if (result.halves)
      render_options.appearance =
          fit_appearance(field, camera, scene.views[v].pose, fitted, render_options, pool, cancel);
    const std::vector<uint8_t> mask = result.halves ? right_half(photo) : photo.mask;
    const Image8 truth = photo_over(photo, render_options.background);
    Frame frame = draw(camera, scene.views[v].pose, at);
    Image8 rendering = to_picture(frame);
    ViewScore score{scene.views[v].name,
                    psnr(truth, rendering, mask),
                    ssim(truth, rendering, pool, mask),
                    scene.views[v].scale,
                    {},
                    {},
                    kinds[v],
                    {},
                    {}};
    if (options.align) {
      const CameraFit fit =
          fit_camera(field, camera, scene.views[v].pose, fitted, render_options, pool, cancel);
      frame = draw(camera, fit.pose, {});
      rendering = to_picture(frame);
      score.aligned_psnr = psnr(truth, rendering, mask);
      score.aligned_ssim = ssim(truth, rendering, pool, mask);
    }
    if (!options.pictures.empty()) {
      score.picture = picture_file(score.name, used).string();
      score.depth = depth_range(frame.depth_z, frame.alpha);
    }
    result.views.push_back(std::move(score));
    if (options.pictures.empty()) continue;
    const ViewScore& written = result.views.back();
    Image8 picture = side_by_side(truth, mask, rendering, frame, written.depth);
    if (!mask.empty()) {
      make_writable_folder(options.pictures / kPictureMasks);
      write_image(options.pictures / kPictureMasks / written.picture,
                  Image8{photo.width, photo.height, 1, mask});
    }
    if (writing.valid()) writing.get();
    writing = std::async(std::launch::async,
                         [picture = std::move(picture), file = options.pictures / written.picture] {
                           write_image(file, picture);
                         });
  }
  if (writing.valid()) writing.get();
  const ScaleScore all = mean_score<ScaleScore>(result.views);
  result.psnr = all.psnr;
  result.ssim = all.ssim;
  result.counted = all.counted;
  result.aligned = options.align;
  result.aligned_psnr = mean(result.views, &ViewScore::aligned_psnr);
  result.aligned_ssim = mean(result.views, &ViewScore::aligned_ssim);
  std::map<int, std::vector<ViewScore>> by_scale;
  for (const ViewScore& s : result.views) by_scale[s.scale].push_back(s);
  for (const auto& [scale, of] : by_scale) {
    result.scales.push_back(mean_score<ScaleScore>(of));
    result.scales.back().scale = scale;
  }
  for (const HeldOut kind : {HeldOut::kSpace, HeldOut::kTime}) {
    std::vector<ViewScore> of;
    std::ranges::copy_if(result.views, std::back_inserter(of),
                         [&](const ViewScore& v) { return v.held_out == kind; });
    if (of.empty()) continue;
    result.held_out.push_back(mean_score<HeldOutScore>(of));
    result.held_out.back().held_out = kind;
  }
  result.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  return result;
}

// Frame (5 numbers), its 8-bit pictures by way of three more, the three pictures side by side, and
// those of the view before with their encoder's copies.
uint64_t evaluation_memory_bytes(uint64_t pixels) { return (8 * sizeof(Real) + 44) * pixels; }

}  // namespace nerf
