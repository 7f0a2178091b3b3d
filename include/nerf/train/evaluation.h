// How close a trained field comes to photos that it has not seen.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "nerf/base/cancel.h"
#include "nerf/base/options.h"
#include "nerf/base/threads.h"
#include "nerf/io/depth_image.h"
#include "nerf/io/image.h"
#include "nerf/io/photos.h"
#include "nerf/io/scene.h"
#include "nerf/model/radiance_field.h"
#include "nerf/model/renderer.h"

namespace nerf {

// Whether a held-out photo's light is found from its left half and its right half alone is
// compared (Martin-Brualla et al. 2021, section 5).
enum class FitLight {
  kAuto,  // where the field has learnt the photos' light
  kOff,   // the field's own light, the whole photo
  kOn,    // right halves, whatever there is to fit: to compare with fields that have learnt light
};
inline auto option_names(FitLight) {
  return std::array{OptionName{FitLight::kAuto, "auto"}, OptionName{FitLight::kOff, "off"},
                    OptionName{FitLight::kOn, "on"}};
}

struct EvaluationOptions {
  int max_views = 0;               // 0: every held-out view; else at most so many, spread evenly
  std::filesystem::path pictures;  // folder for side-by-side pictures; empty: none are written
  Precision precision = Precision::kAuto;  // of the networks' products
  FitLight fit_light = FitLight::kAuto;
  // Scores each view a second time from where a fit by its own photo puts its camera: what a field
  // whose cameras moved is to be compared by. Its lens is the model's.
  bool align = false;
};

// As metrics.h defines them; no value where nothing counts (masked out, or too small a picture).
struct ViewScore {
  std::string name;
  std::optional<double> psnr;  // dB
  std::optional<double> ssim;
  int scale = 1;                                     // View::scale
  std::optional<double> aligned_psnr, aligned_ssim;  // only where cameras are aligned
  HeldOut held_out = HeldOut::kStatic;
  std::string picture;  // file in EvaluationOptions::pictures; empty where none was written
  DepthRange depth;     // of the picture's colours, input unit
};

// Pixels between the parts of side_by_side().
inline constexpr int kPictureGap = 4;
// Folder beside the pictures for masks of those that have one: grey, 0 where a pixel counts
// nowhere.
inline constexpr const char* kPictureMasks = "masks";

// Means over the views of one scale.
struct ScaleScore {
  int scale = 1;
  double psnr = 0, ssim = 0;
  int counted = 0;
};

// Means over the views that are held out alike.
struct HeldOutScore {
  HeldOut held_out = HeldOut::kStatic;
  double psnr = 0, ssim = 0;
  int counted = 0;
};

struct Evaluation {
  std::vector<ViewScore> views;
  std::vector<ScaleScore> scales;      // of each scale that there is
  std::vector<HeldOutScore> held_out;  // of each kind that there is; empty where nothing moves
  double psnr = 0, ssim = 0;           // means over the views that have a value; 0 where none has
  int counted = 0;                     // views with a PSNR
  bool halves = false;                 // right halves were compared, after a fit to the left ones
  bool aligned = false;                // whether there are scores of aligned cameras
  double aligned_psnr = 0, aligned_ssim = 0;
  double seconds = 0;
};

// What is seen where nothing is: the model's background where photos carry alpha, else mid-grey.
Vec3 evaluation_background(const ModelInfo& info);

// The photo in 8 bits, over `background` where it carries alpha.
Image8 photo_over(const Photo& photo, const Vec3& background);

// Photo, rendering and colour-mapped depth in a row; masked-out pixels of the photo are darkened.
Image8 side_by_side(const Image8& photo, const std::vector<uint8_t>& mask, const Image8& rendering,
                    const Frame& frame, const DepthRange& range);

// Renders the views of scene.test at the size of their photos and compares 8-bit pictures (PSNR and
// SSIM of metrics.h), masked-out pixels left out; right halves alone where light is fitted.
// Pictures, from aligned cameras where there are, are named after the views. `progress` gets the
// fraction done. Throws Cancelled, and Error where a picture cannot be written.
Evaluation evaluate(const RadianceField& field, const Scene& scene, const PhotoSet& photos,
                    const EvaluationOptions& options, ThreadPool& pool,
                    const std::function<void(double)>& progress = {},
                    const Cancel* cancel = nullptr);

// Bytes that evaluate() takes for a view of so many pixels, besides field and photos: an estimate.
uint64_t evaluation_memory_bytes(uint64_t pixels);

}  // namespace nerf
