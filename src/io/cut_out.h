// Backgrounds of one colour: found, and turned into alpha.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <vector>

#include "image_decode.h"
#include "nerf/io/cut_out.h"
#include "nerf/io/scene.h"

namespace nerf::internal {

struct SceneInput;

// [height][width], 1 where a pixel is background: of about this colour and joined to the border by
// such pixels, with the specks that compression leaves in it.
std::vector<uint8_t> background_of(const StoredImage& image, const Rgb8& colour);

// Gives the image alpha: 0 in the background, a share along its edge, where colours are mixed,
// 1 elsewhere. Colour becomes straight: over the background's the picture is what it was. An image
// with transparency of its own stays as it is.
void cut_out(StoredImage& image, const Rgb8& colour);

struct CutOutSearch {
  std::optional<Rgb8> colour;
  int looked = 0;  // at so many photos
  // Nearly all photos have the border, but the same one: bars, or what a lens does not reach.
  bool is_frame = false;
};

// Looks at a few of the photos: whether the border of nearly all has one flat colour, within which
// there is the outline of something else, another outline from photo to photo. Photos of 16 bits or
// floats have none.
CutOutSearch find_cut_out(std::span<const std::filesystem::path> photos);

// The colour that the photos' background is cut out to, if it is, by the option and by the photos;
// `alpha`: they carry some. Notes it in the report, the memory that alpha takes included.
std::optional<Rgb8> resolve_cut_out(const SceneInput& input, const CutOut& option, bool alpha,
                                    int downscale, SceneReport& report);

}  // namespace nerf::internal
